//! What a self-test of the board says about its wires.

use shared_proto::CHANNELS;

/// What an emitter raises its own channel by at least, in steps of the converter; a photointerrupter
/// over a reflector gives a thousand.
pub(crate) const LEAST_RISE: i16 = 100;

/// What an emitter raises another channel by at most, as a share of its own; light that leaks under a
/// shell stays below.
const MOST_LEAK: f64 = 0.05;

/// Rise that is noise whatever the emitter, in steps.
const NOISE: f64 = 8.0;

/// What is wrong with an emitter. Channels count from 0 here and from 1 in words.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EmitterFault {
    /// No channel sees it.
    #[error(
        "emitter {} raises no channel: is it wired, with a reflector above it?",
        emitter + 1
    )]
    Dark {
        /// The emitter.
        emitter: usize,
    },
    /// Its own channel does not see it, another one does.
    #[error(
        "emitter {} raises channel {} instead of its own: wires are exchanged",
        emitter + 1, channel + 1
    )]
    Elsewhere {
        /// The emitter.
        emitter: usize,
        /// The channel that sees most of it.
        channel: usize,
    },
    /// Its own channel sees it, and others, too.
    #[error(
        "emitter {} raises channel {} besides its own: a bridge, or light that leaks",
        emitter + 1, numbers(channels)
    )]
    AlsoOthers {
        /// The emitter.
        emitter: usize,
        /// The other channels.
        channels: Vec<usize>,
    },
}

fn numbers(channels: &[usize]) -> String {
    let numbers: Vec<String> = channels.iter().map(|channel| (channel + 1).to_string()).collect();
    numbers.join(" and ")
}

/// Judges what an emitter raises each channel by.
///
/// # Errors
/// [`EmitterFault`] unless it raises its own channel and no other.
pub fn judge(emitter: usize, rise: &[i16; CHANNELS]) -> Result<(), EmitterFault> {
    let own = rise.get(emitter).copied().unwrap_or(0);
    let most = (0..CHANNELS).max_by_key(|&channel| rise[channel]).unwrap_or(emitter);
    if own < LEAST_RISE {
        return Err(match rise[most] >= LEAST_RISE {
            true => EmitterFault::Elsewhere { emitter, channel: most },
            false => EmitterFault::Dark { emitter },
        });
    }
    let limit = (MOST_LEAK * f64::from(own)).max(NOISE);
    let others = (0..CHANNELS).filter(|&channel| channel != emitter);
    let channels: Vec<usize> = others.filter(|&it| f64::from(rise[it]) > limit).collect();
    match channels.is_empty() {
        true => Ok(()),
        false => Err(EmitterFault::AlsoOthers { emitter, channels }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_emitter_is_to_raise_its_own_channel_and_no_other() {
        let good = [3, -2, 1_200, 0, 40, 0, 7, -8];
        assert_eq!(judge(2, &good), Ok(()));
        let said = |emitter, rise| judge(emitter, &rise).unwrap_err().to_string();
        assert!(said(1, good).contains("emitter 2 raises channel 3 instead"));
        assert!(said(0, [5; 8]).contains("emitter 1 raises no channel"));
        let leaks = said(2, [0, 61, 1_200, 0, 0, 0, 900, 0]);
        assert!(leaks.contains("emitter 3 raises channel 2 and 7 besides"), "{leaks}");
    }

    #[test]
    fn noise_is_no_leak_of_a_weak_emitter() {
        assert_eq!(judge(0, &[LEAST_RISE, 8, -9, 7, 0, 0, 0, 0]), Ok(()));
        assert!(judge(0, &[LEAST_RISE, 9, 0, 0, 0, 0, 0, 0]).is_err());
    }
}
