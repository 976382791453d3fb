//! The damping of Levenberg-Marquardt steps (Marquardt 1963, doi:10.1137/0111030).

#[derive(Clone, Copy, Debug)]
pub(crate) struct Damping(f64);

impl Default for Damping {
    fn default() -> Self {
        Self(1e-2)
    }
}

impl Damping {
    /// The factor of the curvature's diagonal in the next step.
    pub(crate) fn scale(self) -> f64 {
        1.0 + self.0
    }

    /// Returns `next`, the state after a step, if it is better. The damping falls after success and rises otherwise,
    /// also if there is no step (`None`) because the damped curvature is not positive definite.
    pub(crate) fn accept<T>(
        &mut self,
        next: Option<T>,
        is_better: impl FnOnce(&T) -> bool,
    ) -> Option<T> {
        let better = next.filter(is_better);
        let factor = if better.is_some() { 0.2 } else { 5.0 };
        self.0 = (self.0 * factor).clamp(1e-12, 1e8);
        better
    }
}
