// Answers requests, each in a fresh instance of the module. A connection with a board has its own instance and worker.
'use strict';
let module, board;

const start = async () => {
  let told = 0;
  // A message costs more than reading a chunk of a log.
  const progress = (bytes) => { if (bytes - told > 1e6) postMessage({ bytes: told = bytes }); };
  const folds = (done, of) => postMessage({ folds: { done, of } });
  return (await WebAssembly.instantiate(module, { page: { progress, folds } })).exports;
};

const run = async (exports, task, request, files) => {
  // `memory.buffer` is looked up last: a call that grows the memory detaches the previous buffer.
  const view = (start, length) => new Uint8Array(exports.memory.buffer, start >>> 0, length);
  const put = (bytes) => view(exports.buffer(bytes.length), bytes.length).set(bytes);
  const output = (at) => view(exports.output(at), exports.output_length(at)).slice();
  const text = (at) => new TextDecoder().decode(output(at));
  try {
    for (const file of files) put(new Uint8Array(await file.arrayBuffer()));
    put(new TextEncoder().encode(JSON.stringify(request)));
    exports[task]();
  } catch (error) {
    if (!(error instanceof WebAssembly.RuntimeError || error instanceof RangeError)) throw error;
    if (exports.outputs() > 0) throw new Error(`a fault of this page, please report it: ${text(0)}`);
    throw new Error('not enough memory: a page has 4 GB at most; the program for the terminal has no such limit');
  }
  const { answer, files: names } = JSON.parse(text(0));
  return { answer, files: names.map((name, at) => ({ name, bytes: output(at + 1) })) };
};

onmessage = async ({ data }) => {
  if (data.module) return void (module = data.module);
  // A hidden page has slow timers, but its workers do not.
  if (data.every) return void setInterval(() => postMessage({ tick: true }), data.every);
  try {
    const done = data.board ? await run(board ??= await start(), 'board', data.board, data.files) : await run(await start(), 'answer', data.request, data.files);
    postMessage({ done });
  } catch (error) {
    postMessage({ done: { answer: { error: error.message }, files: [] } });
  }
};
