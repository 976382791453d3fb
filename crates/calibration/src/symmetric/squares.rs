//! What is left of a symmetric matrix without the squares `x·xᵀ` of some vectors: four vectors at a
//! time, in their order.

use super::{SymmetricMatrix, add_multiple};
use shell_data::vectorised;

vectorised! {
    /// Subtracts `x·xᵀ` of each of `vectors`, as long as a row.
    pub(super) fn subtract_squares(from: &mut SymmetricMatrix, vectors: &[Vec<f64>]) {
        let (fours, others) = vectors.as_chunks::<4>();
        for x in fours {
            let mut rest = from.upper.as_mut_slice();
            for i in 0..from.size {
                let (row, below) = rest.split_at_mut(from.size - i);
                let [p, q, r, s] = x.each_ref().map(|x| &x[i..]);
                let (a, b, c, d) = (p[0], q[0], r[0], s[0]);
                let columns = p.iter().zip(q).zip(r.iter().zip(s));
                for (element, ((p, q), (r, s))) in row.iter_mut().zip(columns) {
                    *element -= (a * p + b * q) + (c * r + d * s);
                }
                rest = below;
            }
        }
        for x in others {
            for i in 0..from.size {
                add_multiple(from.row_mut(i), -x[i], &x[i..]);
            }
        }
    }
}
