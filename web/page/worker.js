// Answers requests, each in a fresh instance of the module.
'use strict';
let module;

const run = async (request, files) => {
  let told = 0;
  // Messages cost more than chunks of a log.
  const progress = (bytes) => { if (bytes - told > 1e6) postMessage({ bytes: told = bytes }); };
  const folds = (done, of) => postMessage({ folds: { done, of } });
  const { exports } = await WebAssembly.instantiate(module, { page: { progress, folds } });
  // `memory.buffer` is looked up last: a call that makes the memory grow detaches the one before.
  const view = (start, length) => new Uint8Array(exports.memory.buffer, start >>> 0, length);
  const put = (bytes) => view(exports.buffer(bytes.length), bytes.length).set(bytes);
  const output = (at) => view(exports.output(at), exports.output_length(at)).slice();
  const text = (at) => new TextDecoder().decode(output(at));
  try {
    for (const file of files) put(new Uint8Array(await file.arrayBuffer()));
    put(new TextEncoder().encode(JSON.stringify(request)));
    exports.answer();
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
  try {
    postMessage({ done: await run(data.request, data.files) });
  } catch (error) {
    postMessage({ done: { answer: { error: error.message }, files: [] } });
  }
};
