//! `cargo xtask setup`: what tests and checks need of a machine.

use anyhow::{Result, ensure};

use crate::equipment::{BROWSER, SHELLS};
use crate::need::Need;
use crate::{check, compiler, python, web};

#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(crate) struct SetupArgs {
    /// Install nothing: name what is missing and how to get it; exit code 1 if anything is
    #[arg(long)]
    no_install: bool,
}

pub(crate) fn run(args: SetupArgs) -> Result<()> {
    let tests = [compiler::BOARD_NEED, python::NEED, BROWSER, SHELLS, web::NEED];
    let needs = [&tests[..], &check::NEEDS].concat();
    let is_missing = |need: &Need| match args.no_install {
        true => !(need.is_met)(),
        false => need.meet().is_err(),
    };
    let missing: Vec<Need> = needs.into_iter().filter(is_missing).collect();
    missing.iter().for_each(|need| println!("{need}"));
    ensure!(missing.is_empty(), "{} of what tests and checks need is missing", missing.len());
    println!("everything that tests and checks need is here");
    Ok(())
}
