//! Requests and records of ATI's "raw data transfer" (RDT), which Net F/T boxes speak over UDP.
//!
//! ```text
//! request   header 0x1234 u16 · command u16 · count u32                                  8 bytes
//! record    rdt_sequence u32 · ft_sequence u32 · status u32 · Fx Fy Fz Tx Ty Tz i32     36 bytes
//! ```
//!
//! Everything is big-endian (ATI 9620-05-Net FT, section 9). `rdt_sequence` counts the records of the stream,
//! `ft_sequence` the samples measured. A count of 0 requests records without end. In buffered mode a datagram holds
//! several records.

pub const PORT: u16 = 49152;

pub const REQUEST_SIZE: usize = 8;

pub const RECORD_SIZE: usize = 36;

/// Maximum records per datagram in buffered mode (field `comrdtbsiz` of the page).
pub const BUFFERED: usize = 40;

const HEADER: u16 = 0x1234;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RdtCommand {
    Stop,
    /// Requests each record as it is measured. The field is the number of records, 0 without end.
    Start(u32),
    /// Requests several records per datagram. The field is the number of datagrams, 0 without end.
    StartBuffered(u32),
    Bias,
}

impl RdtCommand {
    pub fn encode(self) -> [u8; REQUEST_SIZE] {
        let (command, count) = match self {
            Self::Stop => (0_u16, 0),
            Self::Start(count) => (2, count),
            Self::StartBuffered(count) => (3, count),
            Self::Bias => (0x42, 0),
        };
        let mut bytes = [0; REQUEST_SIZE];
        bytes[..2].copy_from_slice(&HEADER.to_be_bytes());
        bytes[2..4].copy_from_slice(&command.to_be_bytes());
        bytes[4..].copy_from_slice(&count.to_be_bytes());
        bytes
    }

    pub fn decode(bytes: &[u8]) -> Option<Self> {
        let bytes: [u8; REQUEST_SIZE] = bytes.try_into().ok()?;
        let [high, low, command_high, command_low, count @ ..] = bytes;
        let count = u32::from_be_bytes(count);
        if u16::from_be_bytes([high, low]) != HEADER {
            return None;
        }
        match u16::from_be_bytes([command_high, command_low]) {
            0 => Some(Self::Stop),
            2 => Some(Self::Start(count)),
            3 => Some(Self::StartBuffered(count)),
            0x42 => Some(Self::Bias),
            _ => None,
        }
    }
}

/// Bits of the status word (ATI 9610-05-Ethernet Axia, table 4.7).
pub mod status {
    /// The sensor was too busy and may have skipped samples; this is no error.
    pub const BUSY: u32 = 1 << 3;
    pub const GAGE_OUT_OF_RANGE: u32 = 1 << 27;
    pub const LOAD_OUT_OF_RANGE: u32 = 1 << 30;
    /// A bit that means an error is set.
    pub const ERROR: u32 = 1 << 31;
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RdtRecord {
    pub rdt_sequence: u32,
    pub ft_sequence: u32,
    pub status: u32,
    /// Fx, Fy, Fz, Tx, Ty, Tz.
    pub counts: [i32; 6],
}

impl RdtRecord {
    pub fn encode(&self) -> [u8; RECORD_SIZE] {
        let mut bytes = [0; RECORD_SIZE];
        let words = [self.rdt_sequence, self.ft_sequence, self.status];
        let words = words.into_iter().chain(self.counts.map(i32::cast_unsigned));
        for (place, word) in bytes.chunks_exact_mut(4).zip(words) {
            place.copy_from_slice(&word.to_be_bytes());
        }
        bytes
    }

    /// Decodes the records of a datagram, unless its size is no multiple of theirs.
    pub fn decode_all(datagram: &[u8]) -> Option<Vec<Self>> {
        let whole = !datagram.is_empty() && datagram.len().is_multiple_of(RECORD_SIZE);
        whole.then(|| datagram.chunks_exact(RECORD_SIZE).map(Self::decode).collect())
    }

    fn decode(bytes: &[u8]) -> Self {
        let mut words = bytes
            .chunks_exact(4)
            .map(|word| u32::from_be_bytes(word.try_into().unwrap_or_default()));
        let mut next = || words.next().unwrap_or_default();
        let (rdt_sequence, ft_sequence, status) = (next(), next(), next());
        let counts = std::array::from_fn(|_| next().cast_signed());
        Self { rdt_sequence, ft_sequence, status, counts }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RdtArrival {
    /// In order, after this number of missing records.
    Next(u32),
    Late,
    Duplicate,
    Restarted,
}

/// Number of records behind the newest among which a late one can still be distinguished from a restart.
const WINDOW: usize = 128;

/// Numbers records without wraps, and determines how each arrived. A record whose number does not increase is late if
/// its place is empty and it was measured before the newest. It is a duplicate if its place holds the same record.
/// Otherwise the box has restarted.
#[derive(Clone, Debug)]
pub struct RdtTracker {
    newest: Option<(RdtRecord, i64)>,
    first: i64,
    /// The last records, each at its number modulo the size.
    recent: Vec<Option<(i64, RdtRecord)>>,
}

impl Default for RdtTracker {
    fn default() -> Self {
        Self { newest: None, first: 0, recent: vec![None; WINDOW] }
    }
}

impl RdtTracker {
    /// Returns a record's number, which continues across wraps and restarts, and its arrival.
    pub fn place(&mut self, record: RdtRecord) -> (i64, RdtArrival) {
        let Some((newest, last)) = self.newest else {
            self.first = i64::from(record.rdt_sequence);
            self.keep(record, self.first);
            return (self.first, RdtArrival::Next(0));
        };
        let step = record.rdt_sequence.wrapping_sub(newest.rdt_sequence).cast_signed();
        let number = last + i64::from(step);
        if step > 0 {
            self.keep(record, number);
            return (number, RdtArrival::Next(step.unsigned_abs() - 1));
        }
        let is_near = (step.unsigned_abs() as usize) < WINDOW;
        let held = self.recent[Self::slot(number)].filter(|(held, _)| *held == number);
        let measured = record.ft_sequence.wrapping_sub(newest.ft_sequence).cast_signed();
        match held {
            Some((_, held)) if is_near && held == record => (number, RdtArrival::Duplicate),
            None if is_near && number >= self.first - WINDOW as i64 && measured <= 0 => {
                self.recent[Self::slot(number)] = Some((number, record));
                (number, RdtArrival::Late)
            }
            _ => {
                self.recent.fill(None);
                self.first = last + 1;
                self.keep(record, self.first);
                (self.first, RdtArrival::Restarted)
            }
        }
    }

    fn keep(&mut self, record: RdtRecord, number: i64) {
        self.newest = Some((record, number));
        self.recent[Self::slot(number)] = Some((number, record));
    }

    fn slot(number: i64) -> usize {
        number.rem_euclid(WINDOW as i64) as usize
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn record(rdt_sequence: u32, ft_sequence: u32) -> RdtRecord {
        RdtRecord { rdt_sequence, ft_sequence, status: 0, counts: [1, -2, 3, -4, 5, i32::MIN] }
    }

    #[test]
    fn requests_are_as_the_manual_has_them() {
        assert_eq!(RdtCommand::Start(0).encode(), [0x12, 0x34, 0, 2, 0, 0, 0, 0]);
        assert_eq!(RdtCommand::StartBuffered(300).encode(), [0x12, 0x34, 0, 3, 0, 0, 1, 44]);
        assert_eq!(RdtCommand::Bias.encode(), [0x12, 0x34, 0, 0x42, 0, 0, 0, 0]);
        for command in [RdtCommand::Stop, RdtCommand::Start(7), RdtCommand::StartBuffered(1)] {
            assert_eq!(RdtCommand::decode(&command.encode()), Some(command));
        }
        for none in [&[][..], &[0x12, 0x34, 0, 2], &[0x12, 0x35, 0, 2, 0, 0, 0, 0], &[0; 9]] {
            assert_eq!(RdtCommand::decode(none), None, "{none:?}");
        }
    }

    #[test]
    fn records_are_big_endian() {
        let bytes = RdtRecord { status: status::ERROR, ..record(1, 258) }.encode();
        assert_eq!(bytes[..12], [0, 0, 0, 1, 0, 0, 1, 2, 0x80, 0, 0, 0]);
        assert_eq!(bytes[12..20], [0, 0, 0, 1, 255, 255, 255, 254]);
        let two = [record(1, 1).encode(), record(2, 2).encode()].concat();
        assert_eq!(RdtRecord::decode_all(&two), Some(vec![record(1, 1), record(2, 2)]));
        assert_eq!(RdtRecord::decode_all(&two[1..]), None);
        assert_eq!(RdtRecord::decode_all(&[]), None);
    }

    fn placed(records: &[(u32, u32)]) -> Vec<(i64, RdtArrival)> {
        let mut tracker = RdtTracker::default();
        records.iter().map(|&(rdt, ft)| tracker.place(record(rdt, ft))).collect()
    }

    #[test]
    fn each_record_is_told_for_what_it_is() {
        use RdtArrival::{Duplicate, Late, Next, Restarted};
        let found = placed(&[(1, 71), (2, 72), (5, 75), (4, 74), (4, 74), (6, 76)]);
        let wanted = [Next(0), Next(0), Next(2), Late, Duplicate, Next(0)];
        assert_eq!(found.iter().map(|it| it.1).collect::<Vec<_>>(), wanted);
        assert_eq!(found.iter().map(|it| it.0).collect::<Vec<_>>(), [1, 2, 5, 4, 4, 6]);
        // A restarted stream: `rdt_sequence` begins again, `ft_sequence` continues.
        assert_eq!(placed(&[(1, 71), (2, 72), (1, 90)])[2], (3, Restarted));
        assert_eq!(placed(&[(5000, 1), (1, 2), (2, 3)])[1..], [(5001, Restarted), (5002, Next(0))]);
        // Power off and on: both begin again.
        assert_eq!(placed(&[(1, 71), (2, 72), (1, 1)])[2], (3, Restarted));
        assert_eq!(placed(&[(u32::MAX, 9), (1, 11)])[1], (i64::from(u32::MAX) + 2, Next(1)));
    }

    proptest! {
        #[test]
        fn any_bytes_are_decoded_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            _ = RdtCommand::decode(&bytes);
            let records = RdtRecord::decode_all(&bytes).unwrap_or_default();
            let again: Vec<u8> = records.iter().flat_map(|record| record.encode()).collect();
            prop_assert!(records.is_empty() || again == bytes);
        }
    }
}
