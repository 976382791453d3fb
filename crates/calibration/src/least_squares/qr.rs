//! The pass that leaves the R factor of [`r_factor`](crate::r_factor).

use super::rows::{Reduction, RowChunk, Shape};
use crate::r_factor::{RFactor, Workspace};

/// Householder QR over row blocks.
pub(super) struct FormRFactor {
    pub(super) shape: Shape,
}

impl Reduction for FormRFactor {
    type Partial = RFactor;
    const WIDE: bool = false;

    fn empty(&self) -> RFactor {
        RFactor::new(self.shape.features, self.shape.outputs)
    }

    fn absorb(&self, partial: &mut RFactor, chunk: &RowChunk<'_>) {
        let mut workspace = Workspace::new(self.shape.features, self.shape.outputs);
        let step = workspace.rows();
        for start in (0..chunk.rows).step_by(step) {
            let rows = step.min(chunk.rows - start);
            partial.absorb(rows, &mut workspace, |columns, stride| {
                for (j, column) in columns.chunks_mut(stride).enumerate() {
                    column[..rows].copy_from_slice(&chunk.column(j)[start..][..rows]);
                }
            });
        }
    }

    fn merge(&self, earlier: &mut RFactor, later: RFactor) {
        earlier.merge(&later);
    }
}
