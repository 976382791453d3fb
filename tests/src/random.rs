//! Pseudo-random numbers, the same on every machine.

/// SplitMix64 (Steele, Lea and Flood, OOPSLA 2014).
#[derive(Clone, Debug)]
pub struct Random(pub u64);

impl Random {
    #[expect(clippy::should_implement_trait, reason = "the numbers have no end")]
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Returns a number of this many bits, from 1 to 64.
    pub fn bits(&mut self, bits: u32) -> u64 {
        self.next() >> (64 - bits)
    }

    pub fn unit(&mut self) -> f64 {
        self.bits(53) as f64 / (1_u64 << 53) as f64
    }

    /// Approximately normal with variance 1: the sum of twelve numbers in −½..½.
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.unit()).sum::<f64>() - 6.0
    }

    pub fn below(&mut self, bound: u64) -> u64 {
        self.next() % bound
    }

    pub fn percent(&mut self, percent: u64) -> bool {
        self.below(100) < percent
    }
}

/// Cuts, flips, duplicates, or replaces the value of a field.
pub fn damage(bytes: &mut Vec<u8>, random: &mut Random) {
    const TEXTS: [&[u8]; 14] = [
        b"1e300",
        b"-1e300",
        b"NaN",
        b"inf",
        b"",
        b"\"",
        b"1e63",
        b"0",
        b"-",
        b"999999999999",
        b"\x1b[2J",
        b"\0",
        b"\n\n\n",
        b"\xff\xfe",
    ];
    if bytes.is_empty() {
        return bytes.extend(TEXTS[random.below(14) as usize]);
    }
    let at = random.below(bytes.len() as u64) as usize;
    match random.below(8) {
        0 => bytes.truncate(at),
        1 => bytes[at] ^= 1 << random.below(8),
        2 => drop(bytes.drain(at..(at + 1 + random.below(200) as usize).min(bytes.len()))),
        3 => {
            let piece = bytes[at..(at + 300).min(bytes.len())].to_vec();
            let to = random.below(bytes.len() as u64) as usize;
            drop(bytes.splice(to..to, piece));
        }
        // A whole field, so that its surroundings stay valid.
        4 | 5 => {
            let is_end = |byte: &u8| matches!(byte, b',' | b'\n' | b'|' | b':' | b'[');
            let start = bytes[..at].iter().rposition(is_end).map_or(0, |end| end + 1);
            let end = bytes[at..].iter().position(is_end).map_or(bytes.len(), |end| at + end);
            let text = TEXTS[random.below(14) as usize];
            drop(bytes.splice(start..end.max(start), text.iter().copied()));
        }
        6 => bytes.extend_from_within(..at),
        _ => bytes.iter_mut().filter(|byte| **byte == b'\n').for_each(|byte| *byte = b'\r'),
    }
}
