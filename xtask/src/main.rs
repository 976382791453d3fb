//! `cargo xtask …`: the tasks of this workspace that take more than one word of cargo.
fn main() {}
