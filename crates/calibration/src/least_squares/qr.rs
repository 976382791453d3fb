//! The pass that leaves the R factor of [`r_factor`](crate::r_factor).

use super::rows::{Reduction, RowChunk};
use crate::r_factor::{RFactor, Workspace};

impl Reduction for RFactor {
    const WIDE: bool = false;

    /// By Householder QR over row blocks.
    fn absorb(&mut self, chunk: &RowChunk<'_>) {
        let features = self.r().ncols();
        let mut workspace = Workspace::new(features, self.whole().ncols() - features);
        let step = workspace.rows();
        for start in (0..chunk.rows).step_by(step) {
            let rows = step.min(chunk.rows - start);
            self.absorb(rows, &mut workspace, |columns, stride| {
                for (j, column) in columns.chunks_mut(stride).enumerate() {
                    column[..rows].copy_from_slice(&chunk.column(j)[start..][..rows]);
                }
            });
        }
    }

    fn merge(&mut self, later: Self) {
        self.merge(&later);
    }
}
