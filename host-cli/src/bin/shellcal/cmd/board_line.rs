//! `shellcal board PORT baud` and `bootloader`: what becomes of the line to the board.

use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use board_link::{Client, Connection, LinkError};
use shared_proto::{BoardId, Command};

use crate::printer::Printer;

pub(super) type BoardClient = Client<Box<dyn Connection>>;

/// How long a board gives a new rate to prove itself, with what a frame under way takes.
const TRIAL: Duration = Duration::from_millis(3_500);

/// Sets board and port to a rate, and makes sure that both have it. `connect` opens the port at a rate.
pub(super) fn set_baud(
    mut client: BoardClient,
    [old, new]: [u32; 2],
    connect: impl Fn(u32, Option<BoardId>) -> anyhow::Result<BoardClient>,
    printer: &Printer,
) -> anyhow::Result<()> {
    let board = client.identify()?.id();
    match client.order(Command::SetBaud { baud: new }) {
        // If only the answer was lost, the board has the rate.
        Ok(()) | Err(LinkError::NoAnswer { .. }) => {}
        Err(error) => return Err(error.into()),
    }
    let changed = Instant::now();
    // Two programs cannot have a port at once.
    drop(client);
    let heard = connect(new, Some(board)).and_then(|mut client| Ok(client.status()?));
    let Err(unheard) = heard else {
        printer.note(format!(
            "the board has {new} baud until its next reset: `--baud {new}` in other commands"
        ));
        return Ok(());
    };
    thread::sleep(TRIAL.saturating_sub(changed.elapsed()));
    connect(old, Some(board))?.status().with_context(|| {
        format!("the board is heard neither at `{new}` baud nor at `{old}`, where it was")
    })?;
    bail!("the board is not heard at `{new}` baud, and is back at `{old}` ({unheard:#})")
}

/// Sends the board into the bootloader of its chip.
pub(super) fn start_bootloader(
    client: &mut BoardClient,
    port: &str,
    printer: &Printer,
) -> anyhow::Result<()> {
    let started = client.order(Command::Bootloader);
    if let Err(LinkError::NoAnswer { .. }) = started {
        // It does not hear the command when that is sent again.
        printer.note("the board may be in its bootloader: perhaps only its answer was lost");
    }
    started?;
    printer.note(format!(
        "the board is in its bootloader: `stm32flash -b 57600 -w FIRMWARE.bin -v -g 0x08000000 {port}` \
         writes to it, a reset leaves it"
    ));
    Ok(())
}
