// A board at a serial port: a worker holds the connection, this page the port, the clock and the screen.
const BOARD_LOGS = [];
const startLiveView = () => {
  const root = byId('live').attachShadow({ mode: 'open' });
  root.innerHTML = byId('live-view').textContent;
  const style = new CSSStyleSheet();
  style.replaceSync(byId('live-style').textContent);
  root.adoptedStyleSheets = [style];
  return liveView(root, (order) => connection?.order(order) ?? Promise.resolve(false));
};

let connection, view;
const openConnection = async (port) => {
  const worker = new Worker(script), module = await compiled;
  // The wall clock continues while a computer sleeps.
  const [began, date] = [performance.now(), Date.now()];
  const writer = port.writable.getWriter();
  const arrived = [], orders = [], pieces = new Map();
  let answered, reader, reading, isBusy = true, ending;

  const ask = (request, files) => new Promise((resolve) => {
    answered = resolve;
    worker.postMessage({ board: request, files });
  });
  const take = ({ answer, files }) => {
    for (const { name, bytes } of files) pieces.set(name, [...(pieces.get(name) ?? []), bytes]);
    for (const name of answer.ended ?? []) keepLog(new File(pieces.get(name), name, { type: 'text/csv' }));
    if (answer.send?.length > 0) writer.write(Uint8Array.from(answer.send)).catch(() => {});
    if (answer.boards?.length > 0) byId('board-is').textContent = answer.boards.map(({ board, firmware, serial }) => `${board}, firmware ${firmware}, serial number ${serial}`).join('; ');
    if (answer.shown) view.show(answer.shown);
    return answer;
  };
  const turn = async (ends) => {
    isBusy = true;
    const order = orders.shift(), bytes = new Blob(arrived.splice(0));
    const now = { elapsed_ms: performance.now() - began, arrival_ms: Date.now() - date };
    const answer = take(await ask({ ...now, order: order?.name ?? null, draws: !document.hidden || ends, ends }, [bytes]));
    order?.resolve(!answer.error);
    isBusy = false;
    return answer;
  };
  const end = async (reason) => {
    if (ending) return;
    ending = true;
    while (isBusy) await new Promise((soon) => { setTimeout(soon, 5); });
    const { error, hint, recorded } = await turn(true);
    close(reason ?? (error ? describe(error, hint) : `${recorded.frames} frames over ${recorded.board_time_s.toFixed(3)} s`), error || reason);
  };
  const close = (said, isError) => {
    ending = true;
    worker.terminate();
    connection = undefined;
    orders.forEach(({ resolve }) => resolve(false));
    hangUp();
    view.say(isError ? 'ended' : said);
    byId('board-status').textContent = isError ? `error: ${said}` : `Disconnected: ${said}`;
    drawBoard();
  };
  // A port closes once its streams are released. Errors are ignored: the device is gone.
  const hangUp = async () => {
    reader?.cancel().catch(() => {});
    await reading;
    await writer.close().catch(() => {});
    writer.releaseLock();
    await port.close().catch(() => {});
  };
  // Reads until the port is gone; returns the reason. After line errors or an overrun, it continues with a new stream.
  const read = async () => {
    for (let stream = port.readable; stream && !ending; stream = port.readable) {
      reader = stream.getReader();
      try {
        for (;;) {
          const { value, done } = await reader.read();
          if (done) return '';
          arrived.push(value);
        }
      } catch (error) {
        if (!port.readable || port.readable === stream) return `: ${error.message}`;
      } finally {
        reader.releaseLock();
      }
    }
    return '';
  };

  worker.onmessage = async ({ data }) => {
    if (data.done) return answered(data.done);
    if (isBusy || ending) return;
    const { error, hint } = await turn(false);
    if (error && !ending) close(describe(error, hint), true);
  };
  worker.onerror = () => close('the worker of this page has ended', true);
  worker.postMessage({ module });
  const wanted = (id) => (byId(id).value === '' ? null : boardFiles[id][byId(id).value]);
  const files = ['board-calibration', 'board-plan'].map(wanted);
  const chosen = files.filter((file) => file);
  const begun = take(await ask({
    name: 'the port', framing: byId('framing').value || null, starts: byId('starts').checked, records: byId('records').checked, logs: BOARD_LOGS.length,
    calibration: files[0] && { name: files[0].name, file: 0 }, plan: files[1] && { name: files[1].name, file: chosen.length - 1 },
  }, chosen));
  if (begun.error) return close(describe(begun.error, begun.hint), true);
  isBusy = false;
  reading = read();
  reading.then((why) => end(`the port is gone${why}; what arrived until then is kept`));
  connection = { end, order: (name) => new Promise((resolve) => { orders.push({ name, resolve }); }) };
  worker.postMessage({ every: 33 });
};

const describe = (error, hint) => (hint ? `${error}. Hint: ${hint}` : error);

// A recording is a file like a dropped one, and can be saved.
const keepLog = (file) => {
  BOARD_LOGS.push(file);
  byId('recorded').append(element('a', { href: URL.createObjectURL(file), download: file.name }, `Save ${file.name}`));
  add([file]);
};

let boardFiles = { 'board-calibration': [], 'board-plan': [] };
const drawBoard = () => {
  byId('connect').hidden = Boolean(connection);
  byId('disconnect').hidden = !connection;
  for (const control of byId('board-choices').querySelectorAll('select, input')) control.disabled = Boolean(connection);
};
// Lists the calibrations and tables of loads to choose from.
const offerBoard = (calibrations, names, plans) => {
  if (connection) return;
  boardFiles = { 'board-calibration': calibrations, 'board-plan': plans };
  options(byId('board-calibration'), [['', 'none: readings'], ...names.map((name, at) => [String(at), name])]);
  options(byId('board-plan'), [['', 'none'], ...plans.map(({ name }, at) => [String(at), name])]);
};

byId('connect').onclick = async () => {
  byId('board-status').textContent = '';
  byId('board-is').textContent = '';
  try {
    const port = await navigator.serial.requestPort();
    await port.open({ baudRate: Number(byId('baud').value), bufferSize: 1 << 16 });
    byId('live').hidden = false;
    view ??= startLiveView();
    await openConnection(port);
    drawBoard();
  } catch (error) {
    // A cancelled choice is not an error.
    if (error.name !== 'NotFoundError') byId('board-status').textContent = `error: ${error.message}`;
  }
};
byId('disconnect').onclick = () => connection?.end();
window.onbeforeunload = (event) => { if (connection) event.preventDefault(); };
byId('no-serial').hidden = 'serial' in navigator;
byId('board-choices').hidden = !('serial' in navigator);
