//! Where the digits of a number stand in a register of 16 bytes that ends with it.

/// For each number of decimals, where digits are taken from: those before the point come one place
/// closer. Where there are no decimals, there is no point.
pub(crate) const CLOSE_UP: [[u8; 16]; 16] = {
    let mut rows = [[0; 16]; 16];
    let mut decimals = 0;
    while decimals < rows.len() {
        let mut i = 0;
        while i < 16 {
            let is_before_point = decimals > 0 && i + decimals < 16;
            // 0x80 gives zero: the first place is left without a source.
            rows[decimals][i] = match (is_before_point, i) {
                (false, _) => i as u8,
                (true, 0) => 0x80,
                (true, _) => i as u8 - 1,
            };
            i += 1;
        }
        decimals += 1;
    }
    rows
};

/// For each number of digits from 1 on, a mask of as many bytes at the end.
pub(crate) const LAST: [[u8; 16]; 16] = {
    let mut rows = [[0; 16]; 16];
    let mut digits = 1;
    while digits <= rows.len() {
        let mut i = 16 - digits;
        while i < 16 {
            rows[digits - 1][i] = 0xff;
            i += 1;
        }
        digits += 1;
    }
    rows
};
