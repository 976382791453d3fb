//! Who may change the board.

use shared_proto::{Answer, BoardId, Challenge, Command, Key, Refusal, Signature};

/// The key, and the books of what was signed with it.
#[derive(Clone, Debug)]
pub(crate) struct Guard {
    key: Option<Key>,
    /// Of this run of the board; without one nothing can be signed.
    nonce: Option<[u8; 8]>,
    counter: u32,
    /// The last command that was accepted, and the answer, once it is there.
    last: Option<(Signature, Option<Answer>)>,
    refused: u32,
}

/// What is to become of a command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Verdict {
    /// It is done.
    Pass,
    /// It was done: its answer was lost.
    Again(Answer),
    /// It is being done.
    Wait,
    /// It is not.
    Refuse(Refusal),
}

impl Guard {
    pub(crate) const fn new(key: Option<Key>, nonce: Option<[u8; 8]>) -> Self {
        Self { key, nonce, counter: 0, last: None, refused: 0 }
    }

    /// From now on this key, or none.
    pub(crate) fn set_key(&mut self, key: Option<Key>) {
        self.key = key;
    }

    /// What signatures have to be made with.
    pub(crate) fn challenge(&self) -> Challenge {
        Challenge {
            is_keyed: self.key.is_some(),
            nonce: self.nonce.unwrap_or_default(),
            counter: self.counter,
            refused: self.refused,
        }
    }

    /// Judges a command for this board.
    pub(crate) fn judge(
        &mut self,
        number: u16,
        to: Option<BoardId>,
        command: &Command,
        signature: Option<&Signature>,
    ) -> Verdict {
        let Some(key) = &self.key else { return Verdict::Pass };
        let refusal = match (signature, self.nonce) {
            (None, _) if command.is_for_all() => return Verdict::Pass,
            (None, _) => Refusal::Unsigned,
            (Some(signature), Some(nonce))
                if key.accepts(signature, &nonce, number, to, command) =>
            {
                match self.last {
                    Some((last, answer)) if last == *signature => {
                        return answer.map_or(Verdict::Wait, Verdict::Again);
                    }
                    _ if signature.counter <= self.counter => Refusal::Replayed,
                    _ => {
                        self.counter = signature.counter;
                        self.last = Some((*signature, None));
                        return Verdict::Pass;
                    }
                }
            }
            (Some(_), _) => Refusal::BadSignature,
        };
        self.refused = self.refused.saturating_add(1);
        Verdict::Refuse(refusal)
    }

    /// The answer to the command that was let pass last.
    pub(crate) fn answered(&mut self, signature: Option<&Signature>, answer: Answer) {
        if let (Some((last, kept)), Some(signature)) = (&mut self.last, signature)
            && last == signature
        {
            *kept = Some(answer);
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use std::vec::Vec;

    const NONCE: [u8; 8] = *b"one run.";

    fn key(byte: u8) -> Key {
        Key::new([byte; Key::LEN]).unwrap()
    }

    fn command(number: u32) -> Command {
        Command::SetPeriod { period_us: 1_000 + number }
    }

    struct Sent {
        number: u16,
        command: Command,
        signature: Signature,
    }

    fn sent(key: &Key, nonce: &[u8; 8], counter: u32) -> Sent {
        let (number, command) = (counter as u16, command(counter));
        Sent { number, command, signature: key.sign(nonce, counter, number, None, &command) }
    }

    fn judge(guard: &mut Guard, sent: &Sent) -> Verdict {
        guard.judge(sent.number, None, &sent.command, Some(&sent.signature))
    }

    #[test]
    fn a_hundred_thousand_replayed_reordered_and_forged_commands_are_refused() {
        let mut guard = Guard::new(Some(key(1)), Some(NONCE));
        let good: Vec<Sent> = (1..=1_000).map(|counter| sent(&key(1), &NONCE, counter)).collect();
        // Every second one arrives; those between come later, out of order.
        for sent in good.iter().skip(1).step_by(2) {
            assert_eq!(judge(&mut guard, sent), Verdict::Pass);
            guard.answered(Some(&sent.signature), Answer::Done);
            // The same again is one whose answer was lost.
            assert_eq!(judge(&mut guard, sent), Verdict::Again(Answer::Done));
        }
        let mut refused = 0;
        let mut expect = |guard: &mut Guard, sent: &Sent, refusal| {
            assert_eq!(judge(guard, sent), Verdict::Refuse(refusal));
            refused += 1;
        };
        let mut state = 1_u64;
        let mut random = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 33) as u32
        };
        let last = good.len() - 1;
        let (other_key, other_run) = (key(2), *b"another.");
        for i in 0..25_000_u32 {
            // Replayed and reordered: anything but the last.
            let old = &good[random() as usize % last];
            expect(&mut guard, old, Refusal::Replayed);
            // Forged with another key, and recorded on another run of the board.
            expect(&mut guard, &sent(&other_key, &NONCE, 2_000 + i), Refusal::BadSignature);
            expect(&mut guard, &sent(&key(1), &other_run, 2_000 + i), Refusal::BadSignature);
            // A good one for another command, number or counter.
            let mut changed = sent(&key(1), &NONCE, 2_000 + i);
            match i % 3 {
                0 => changed.command = command(i),
                1 => changed.number ^= 1 << (i % 16),
                _ => changed.signature.counter ^= 1 << (i % 32),
            }
            expect(&mut guard, &changed, Refusal::BadSignature);
        }
        assert_eq!((refused, guard.challenge().refused), (100_000, 100_000));
        // None of it has moved the counter.
        assert_eq!(guard.challenge().counter, 1_000);
        assert_eq!(judge(&mut guard, &sent(&key(1), &NONCE, 1_001)), Verdict::Pass);
    }

    #[test]
    fn what_only_asks_needs_no_signature_and_a_board_without_a_key_none_at_all() {
        let mut guard = Guard::new(Some(key(1)), Some(NONCE));
        assert_eq!(guard.judge(1, None, &Command::Status, None), Verdict::Pass);
        let unsigned = guard.judge(1, None, &command(0), None);
        assert_eq!(unsigned, Verdict::Refuse(Refusal::Unsigned));
        // Where one comes along it is looked at.
        let (number, command) = (5, Command::Status);
        let signature = key(2).sign(&NONCE, 1, number, None, &command);
        let forged = guard.judge(number, None, &command, Some(&signature));
        assert_eq!(forged, Verdict::Refuse(Refusal::BadSignature));
        guard.set_key(None);
        assert_eq!(guard.judge(1, None, &Command::Zero { frames: 1 }, None), Verdict::Pass);
    }

    #[test]
    fn without_a_nonce_nothing_is_accepted() {
        let mut guard = Guard::new(Some(key(1)), None);
        let sent = sent(&key(1), &[0; 8], 1);
        assert_eq!(judge(&mut guard, &sent), Verdict::Refuse(Refusal::BadSignature));
    }
}
