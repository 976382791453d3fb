//! The interface between page and module: the page fills buffers (the request is the last), asks
//! for the answer, and reads the outputs (the first is JSON). A panic ends the instance and leaves
//! its message as the only output; exhausted memory leaves none.
#![expect(unsafe_code, reason = "names that a page calls, and a function that it gives")]

use std::cell::RefCell;
use std::sync::Arc;

use serde_json::json;

use crate::{Answer, BoardSession, Progress};

#[link(wasm_import_module = "page")]
unsafe extern "C" {
    /// Reports the number of bytes of logs read so far.
    safe fn progress(bytes: f64);
    /// Reports the number of completed folds of the physics model.
    safe fn folds(done: usize, of: usize);
}

thread_local! {
    static BOARD: RefCell<Option<BoardSession>> = const { RefCell::new(None) };
    static BUFFERS: RefCell<Vec<Arc<[u8]>>> = const { RefCell::new(Vec::new()) };
    static OUTPUTS: RefCell<Vec<Vec<u8>>> = const { RefCell::new(Vec::new()) };
}

/// Returns the start of a new buffer, which has to be filled before any other call.
#[unsafe(no_mangle)]
extern "C" fn buffer(length: usize) -> *mut u8 {
    let mut bytes: Arc<[u8]> = std::iter::repeat_n(0, length).collect();
    let start = Arc::get_mut(&mut bytes).map_or(std::ptr::null_mut(), <[u8]>::as_mut_ptr);
    BUFFERS.with_borrow_mut(|buffers| buffers.push(bytes));
    start
}

#[unsafe(no_mangle)]
extern "C" fn answer() {
    let (files, request) = taken();
    let progress =
        Progress { bytes: &|bytes| progress(bytes as f64), folds: &|done, of| folds(done, of) };
    give(crate::answer(&request, &files, progress));
}

/// Begins a connection with a board, or takes a turn in it.
#[unsafe(no_mangle)]
extern "C" fn board() {
    let (files, request) = taken();
    give(BOARD.with_borrow_mut(|board| match board {
        Some(session) => session.turn(&request, files.first().map_or(&[], |bytes| bytes)),
        None => {
            let (begun, answer) = BoardSession::begin(&request, &files);
            *board = begun;
            answer
        }
    }));
}

fn taken() -> (Vec<Arc<[u8]>>, Arc<[u8]>) {
    std::panic::set_hook(Box::new(|panic| OUTPUTS.set(vec![panic.to_string().into_bytes()])));
    let mut files = BUFFERS.take();
    let request = files.pop().unwrap_or_default();
    (files, request)
}

fn give(Answer { document, files }: Answer) {
    let (names, contents): (Vec<String>, Vec<Vec<u8>>) = files.into_iter().unzip();
    let document = json!({ "answer": document, "files": names }).to_string().into_bytes();
    OUTPUTS.set([vec![document], contents].concat());
}

#[unsafe(no_mangle)]
extern "C" fn outputs() -> usize {
    OUTPUTS.with_borrow(Vec::len)
}

#[unsafe(no_mangle)]
extern "C" fn output(number: usize) -> *const u8 {
    OUTPUTS.with_borrow(|all| all.get(number).map_or(std::ptr::null(), |bytes| bytes.as_ptr()))
}

#[unsafe(no_mangle)]
extern "C" fn output_length(number: usize) -> usize {
    OUTPUTS.with_borrow(|all| all.get(number).map_or(0, Vec::len))
}
