'use strict';
const byId = (id) => document.getElementById(id);
const element = (name, properties = {}, ...children) => {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
};
const inflated = (id) => {
  const packed = Uint8Array.from(atob(byId(id).textContent.trim()), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream('gzip')));
};

// A single worker handles requests in sequence; cancelling terminates it.
const compiled = inflated('module').arrayBuffer().then((bytes) => WebAssembly.compile(bytes));
const script = URL.createObjectURL(new Blob([byId('worker').textContent], { type: 'text/javascript' }));
let worker, ending;
let queue = Promise.resolve();
const cancel = () => {
  worker?.terminate();
  worker = undefined;
  ending?.({ answer: { error: 'cancelled' }, files: [] });
};
const ask = (request, files, progress) => {
  const work = async () => {
    if (!worker) {
      worker = new Worker(script);
      worker.postMessage({ module: await compiled });
    }
    return new Promise((resolve) => {
      ending = resolve;
      worker.onmessage = ({ data }) => (data.done ? resolve(data.done) : progress?.(data));
      worker.onerror = () => resolve({ answer: { error: 'the worker of this page has ended' }, files: [] });
      worker.postMessage({ request, files });
    });
  };
  return (queue = queue.then(work).catch((error) => ({ answer: { error: error.message }, files: [] })));
};

// State of the page: files with their kinds, and the columns assigned by the user.
let logs = [];
let columns = {};
let made = [];

const roles = { fit: 'fit to it', test: 'test on it', '': 'leave out' };
const wanted = (role) => logs.filter((log) => log.role === role);
const reference = (chosen) => chosen.map(({ file }, at) => ({ name: file.name, file: at }));

const add = async (files) => {
  const added = [...files].map((file) => ({ file, role: '', answer: null }));
  logs.push(...added);
  await examine(added);
};

const examine = async (which) => {
  which.forEach((log) => { log.answer = null; });
  draw();
  for (const log of which) {
    if (!logs.includes(log)) continue;
    const request = { task: 'examine', log: { name: log.file.name, file: 0 }, columns };
    const { answer } = await ask(request, [log.file]);
    if (!logs.includes(log)) continue;
    log.answer = answer;
    if (!log.seen) log.role = !answer.fits ? '' : /test/i.test(log.file.name) && wanted('fit').length > 0 ? 'test' : 'fit';
    log.seen = true;
    if (logs.length < 20 || log === which.at(-1)) draw();
  }
};

const finding = ({ severity, check, seen, advice }) => element('li', { className: severity },
  element('strong', {}, severity === 'fine' ? 'ok' : severity), ` ${check}: ${seen}`, advice ? ` → ${advice}` : '');

const drawFile = (log, at) => {
  const { file, answer, role } = log;
  const row = element('div', { className: 'file' }, element('p', {}, element('strong', {}, file.name), ` ${answer ? answer.kind ?? '' : '…'}`));
  if (!answer) return row;
  if (answer.error) return row.append(element('p', { className: 'fault' }, `error: ${answer.error}`)), row;
  if (answer.fits) {
    const select = element('select', { id: `role-${at}`, onchange: () => { log.role = select.value; drawChoices(); } },
      ...Object.entries(roles).map(([value, text]) => element('option', { value, selected: value === role }, text)));
    row.append(element('p', {}, element('label', { htmlFor: select.id, className: 'quiet' }, 'Use: '), select));
  }
  if (answer.findings.length > 0) row.append(element('ul', {}, ...answer.findings.map(finding)));
  return row;
};

const options = (select, entries) => {
  const before = select.value;
  select.replaceChildren(...entries.map(([value, text]) => element('option', { value, selected: value === before }, text)));
};

const draw = () => {
  byId('list').replaceChildren(...logs.map(drawFile));
  drawChoices();
};

const drawChoices = () => {
  byId('clear').hidden = logs.length === 0;
  byId('fit-section').hidden = wanted('fit').length === 0;
  const first = logs.find(({ answer }) => answer?.columns?.length > 0);
  byId('columns-section').hidden = !first;
  if (first) drawColumns(first);
  const calibrations = [...made, ...logs.filter(({ answer }) => answer?.is_calibration).map(({ file }) => file)];
  const readings = logs.filter(({ answer }) => answer?.has_readings);
  byId('convert-section').hidden = calibrations.length === 0 || readings.length === 0;
  const names = calibrations.map((file) => (made.includes(file) ? 'the one that was fitted' : file.name));
  options(byId('calibration'), names.map((name, at) => [String(at), name]));
  offerBoard(calibrations, names, logs.filter(({ answer }) => answer?.is_plan).map(({ file }) => file));
  options(byId('log'), readings.map((log) => [String(logs.indexOf(log)), log.file.name]));
  byId('convert').onclick = () => convert(calibrations[byId('calibration').value], logs[byId('log').value].file);
};

const AXES = ['Fx', 'Fy', 'Fz', 'Mx', 'My', 'Mz'];
const meanings = [['', 'nothing'], ['time', 'time'], ['group', 'group'], ...AXES.map((axis) => [axis, axis]),
  ...Array.from({ length: 32 }, (_, at) => [`sensor ${at + 1}`, `sensor ${at + 1}`])];
const drawColumns = ({ file, answer }) => {
  byId('columns-of').textContent = file.name;
  const row = ({ name, meaning }, at) => {
    const known = (meaning ?? '').replace(/ \(.*/, '');
    const select = element('select', { onchange: assign }, ...meanings.map(([value, text]) => element('option', { value, selected: value === known }, text)));
    select.setAttribute('aria-label', `Column ${at + 1}, ${name || 'without a name'}, is`);
    return element('tr', {}, element('td', { className: 'text' }, `${at + 1} ${name}`), element('td', { className: 'text' }, select));
  };
  const focused = assignments().indexOf(document.activeElement);
  byId('columns').replaceChildren(...answer.columns.map(row));
  assignments()[focused]?.focus();
  if (!answer.has_readings) byId('columns-details').open = true;
};
const assignments = () => [...byId('columns').querySelectorAll('select')];
const assign = () => {
  const chosen = assignments().map((select) => select.value);
  const place = (meaning) => (chosen.includes(meaning) ? chosen.indexOf(meaning) + 1 : null);
  const sensors = meanings.map(([value]) => (value.startsWith('sensor') ? place(value) : null)).filter((at) => at);
  const wrench = AXES.map(place);
  columns = {
    sensors: sensors.length > 0 ? sensors : null, wrench: wrench.some((at) => at) ? wrench : null, time: place('time'), group: place('group'),
    moments_in_mnm: byId('unit').value === '' ? null : byId('unit').value === 'true',
  };
  logs.forEach((log) => { log.seen = false; });
  examine(logs.filter(({ answer }) => answer && !answer.is_calibration));
};

// Runs a request and shows its progress.
const work = async (doing, request, files) => {
  const all = files.reduce((sum, file) => sum + file.size, 0);
  const bar = byId('progress');
  bar.removeAttribute('value');
  byId('doing').textContent = doing;
  byId('status').textContent = '';
  byId('result-section').hidden = true;
  byId('work-section').hidden = false;
  const answered = await ask(request, files, ({ bytes, folds }) => {
    if (folds) byId('doing').textContent = `${doing}: folds of the physics model`;
    const share = folds ? folds.done / folds.of : bytes / all;
    if (share < 1) bar.value = share; else bar.removeAttribute('value');
  });
  byId('work-section').hidden = true;
  const { error, hint } = answered.answer;
  if (error) byId('status').replaceChildren(`error: ${error}`, ...(hint ? [element('br'), `hint: ${hint}`] : []));
  return error ? null : answered;
};

const remark = ({ kind, text }) => element('li', kind === 'warning' ? { className: 'warning' } : {},
  ...(kind === 'warning' ? [element('strong', {}, 'Warning: ')] : []), text);
const links = (files) => element('p', { className: 'choices' }, ...files.map(({ name, bytes }) =>
  element('a', { href: URL.createObjectURL(new Blob([bytes])), download: name }, `Save ${name}`)));
const show = (...parts) => {
  byId('result').querySelectorAll('a[download]').forEach(({ href }) => URL.revokeObjectURL(href));
  byId('result').replaceChildren(...parts);
  byId('result-section').hidden = false;
  byId('status').textContent = 'Done.';
  byId('result-heading').focus();
};

const fit = async () => {
  const [train, test] = [wanted('fit'), wanted('test')];
  const chosen = reference([...train, ...test]);
  const request = {
    task: 'fit', train: chosen.slice(0, train.length), test: chosen.slice(train.length), columns, model: byId('model').value,
    hold_out: byId('hold-out').value || null, date: new Date().toISOString().replace(/\.\d+Z$/, 'Z'),
  };
  const answered = await work('Fitting', request, [...train, ...test].map(({ file }) => file));
  if (!answered) return;
  const { answer: { verdict, ok, remarks }, files } = answered;
  made = [new File([files[0].bytes], files[0].name)];
  draw();
  // The report uses this page's style: the page's policy allows no other.
  const html = new TextDecoder().decode(files[1].bytes).replace(/<style>[^]*?<\/style>/, '');
  const report = new DOMParser().parseFromString(html, 'text/html');
  // Its ids get a prefix, since they also occur in this page.
  report.querySelectorAll('[id]').forEach((part) => { part.id = `report-${part.id}`; });
  report.querySelectorAll('[aria-labelledby]').forEach((part) => part.setAttribute('aria-labelledby', `report-${part.getAttribute('aria-labelledby')}`));
  report.querySelectorAll('a[href^="#"]').forEach((link) => { link.hash = `report-${link.hash.slice(1)}`; });
  const said = element('pre', { className: ok ? 'verdict' : 'verdict useless' }, verdict.join('\n'));
  show(said, links(files), element('ul', {}, ...remarks.map(remark)), element('div', {}, ...report.querySelector('main').children));
};

const convert = async (calibration, log) => {
  const request = { task: 'convert', calibration: { name: calibration.name, file: 0 }, log: { name: log.name, file: 1 }, columns };
  const answered = await work('Converting', request, [calibration, log]);
  if (!answered) return;
  const { answer: { frames, remarks, figure }, files } = answered;
  const parts = [element('p', {}, `${frames} frames`), links(files), element('ul', {}, ...remarks.map(remark))];
  if (figure) {
    const drawing = new DOMParser().parseFromString(figure, 'image/svg+xml').documentElement;
    drawing.setAttribute('role', 'img');
    drawing.setAttribute('aria-label', `Forces and moments of ${log.name} over time`);
    const box = element('div', { className: 'table drawing', tabIndex: 0 }, drawing);
    box.setAttribute('role', 'region');
    box.setAttribute('aria-label', 'Figure: forces over time');
    parts.push(element('figure', {}, box, element('figcaption', {}, 'Forces and moments over time')));
  }
  show(...parts);
};

byId('files').onchange = ({ target }) => { add(target.files); target.value = ''; };
byId('clear').onclick = () => { [logs, columns, made] = [[], {}, []]; cancel(); draw(); };
byId('example').onclick = async () => {
  const example = async (id, name) => new File([await inflated(id).arrayBuffer()], name);
  add([await example('train-csv', 'synthetic-train.csv'), await example('test-csv', 'synthetic-test.csv')]);
};
byId('unit').onchange = assign;
byId('fit').onclick = fit;
byId('cancel').onclick = cancel;
const drop = byId('drop');
document.ondragover = (event) => { event.preventDefault(); drop.classList.add('over'); };
document.ondragleave = () => drop.classList.remove('over');
document.ondrop = (event) => { event.preventDefault(); drop.classList.remove('over'); add(event.dataTransfer.files); };
compiled.then(() => { document.documentElement.dataset.ready = 'true'; }, (error) => { byId('status').textContent = `this browser cannot run the page: ${error.message}`; });
