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

/// Judges what an emitter raises each channel by.
///
/// # Errors
/// Unless it raises its own channel and no other: what is wrong, in words, in which channels count from 1.
pub fn judge(emitter: usize, rise: &[i16; CHANNELS]) -> Result<(), String> {
    let number = emitter + 1;
    let own = rise.get(emitter).copied().unwrap_or(0);
    let most = (0..CHANNELS).max_by_key(|&channel| rise[channel]).unwrap_or(emitter);
    if own < LEAST_RISE {
        return Err(match rise[most] >= LEAST_RISE {
            true => {
                format!(
                    "emitter {number} raises channel {} instead of its own: wires are exchanged",
                    most + 1
                )
            }
            false => {
                format!(
                    "emitter {number} raises no channel: is it wired, with a reflector above it?"
                )
            }
        });
    }
    let limit = (MOST_LEAK * f64::from(own)).max(NOISE);
    let others = (0..CHANNELS).filter(|&channel| channel != emitter);
    let channels = others.filter(|&it| f64::from(rise[it]) > limit);
    let channels: Vec<String> = channels.map(|channel| (channel + 1).to_string()).collect();
    match channels.join(" and ").as_str() {
        "" => Ok(()),
        others => Err(format!(
            "emitter {number} raises channel {others} besides its own: a bridge, or light that leaks"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_emitter_is_to_raise_its_own_channel_and_no_other() {
        let good = [3, -2, 1_200, 0, 40, 0, 7, -8];
        assert_eq!(judge(2, &good), Ok(()));
        let said = |emitter, rise| judge(emitter, &rise).unwrap_err();
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
