#![allow(unreachable_pub, reason = "modules of a test have no outside")]

mod common;
mod damage;
mod detect;
mod golden;
mod stream;
