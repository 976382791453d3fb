//! The wrench on the shell: axis order, names and units. Frame: x forward, y left, z up. Forces in N, moments in N·m.
//! *Drag* is −Fx, *lift* is Fz.

use std::fmt;

/// An axis of the wrench, in the order used everywhere.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// Force forward, N.
    Fx,
    /// Force to the left, N.
    Fy,
    /// Force up, N.
    Fz,
    /// Moment about x, N·m.
    Mx,
    /// Moment about y, N·m.
    My,
    /// Moment about z, N·m.
    Mz,
}

impl Axis {
    pub const ALL: [Axis; 6] = [Axis::Fx, Axis::Fy, Axis::Fz, Axis::Mx, Axis::My, Axis::Mz];

    pub const fn index(self) -> usize {
        self as usize
    }

    /// Returns the name in messages: `Fx` … `Mz`.
    pub const fn name(self) -> &'static str {
        ["Fx", "Fy", "Fz", "Mx", "My", "Mz"][self.index()]
    }

    /// Returns the name of columns and fields in files: `fx_n` … `mz_nm`.
    pub const fn column(self) -> &'static str {
        ["fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"][self.index()]
    }

    pub const fn unit(self) -> &'static str {
        if self.is_moment() { "N·m" } else { "N" }
    }

    pub const fn is_moment(self) -> bool {
        matches!(self, Axis::Mx | Axis::My | Axis::Mz)
    }
}

/// One value per axis, in the order of [`Axis::ALL`].
pub type PerAxis<T> = [T; 6];

/// Standard errors of a load that is a force at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadErrors {
    /// Error of the magnitude, N.
    pub force_n: f64,
    /// Error of the direction: angle about each of two perpendicular axes, rad.
    pub angle_rad: f64,
    /// Error of each coordinate of the point, m.
    pub lever_m: f64,
}

/// Returns the wrench about the origin of a force (N) at a point (m): the force, and `point × force`.
pub fn force_at(force: [f64; 3], point: [f64; 3]) -> PerAxis<f64> {
    let ([fx, fy, fz], [mx, my, mz]) = (force, cross(point, force));
    [fx, fy, fz, mx, my, mz]
}

pub fn cross([ax, ay, az]: [f64; 3], [bx, by, bz]: [f64; 3]) -> [f64; 3] {
    [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]
}

/// A set of wrench axes, in order. A wrench in memory has all six ([`PerAxis`]), with zero for
/// absent axes; output contains only the axes that are present, which [`Axes::of`] selects.
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct Axes(u8);

impl Axes {
    pub const ALL: Self = Self(0b11_1111);
    pub const NONE: Self = Self(0);

    pub const fn contains(self, axis: Axis) -> bool {
        self.0 & 1 << axis.index() != 0
    }

    /// Returns true for a superset of `others`.
    pub const fn contain(self, others: Self) -> bool {
        others.0 & !self.0 == 0
    }

    pub fn iter(self) -> impl DoubleEndedIterator<Item = Axis> + Clone {
        Axis::ALL.into_iter().filter(move |axis| self.contains(*axis))
    }

    pub const fn count(self) -> usize {
        self.0.count_ones() as usize
    }

    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    pub const fn are_all(self) -> bool {
        self.0 == Self::ALL.0
    }

    pub const fn and(self, others: Self) -> Self {
        Self(self.0 & others.0)
    }

    pub const fn without(self, others: Self) -> Self {
        Self(self.0 & !others.0)
    }

    pub fn of<T: Clone>(self, values: &PerAxis<T>) -> Vec<T> {
        self.iter().map(|axis| values[axis.index()].clone()).collect()
    }

    pub fn values<T: Clone>(self, values: &PerAxis<T>) -> AxisValues<T> {
        self.iter().map(|axis| (axis, values[axis.index()].clone())).collect()
    }

    /// Returns `values`, one per axis in the set, at the positions of their axes, and `absent` elsewhere. `None` if the
    /// number of values differs from the number of axes.
    pub fn spread<T: Clone>(self, values: Vec<T>, absent: &T) -> Option<PerAxis<T>> {
        if values.len() != self.count() {
            return None;
        }
        let mut spread: PerAxis<T> = std::array::from_fn(|_| absent.clone());
        for (axis, value) in self.iter().zip(values) {
            spread[axis.index()] = value;
        }
        Some(spread)
    }

    pub fn columns(self) -> Vec<&'static str> {
        self.iter().map(Axis::column).collect()
    }
}

impl FromIterator<Axis> for Axes {
    fn from_iter<I: IntoIterator<Item = Axis>>(axes: I) -> Self {
        Self(axes.into_iter().fold(0, |all, axis| all | 1 << axis.index()))
    }
}

impl fmt::Display for Axes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<&str> = self.iter().map(Axis::name).collect();
        f.write_str(&names.join(", "))
    }
}

impl fmt::Debug for Axes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.iter()).finish()
    }
}

/// One value for each axis of a set, in order.
pub type AxisValues<T> = Vec<(Axis, T)>;

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum MomentUnit {
    #[serde(rename = "N·m")]
    NewtonMetre,
    /// mN·m, equal to N·mm
    #[serde(rename = "mN·m")]
    MillinewtonMetre,
}

impl MomentUnit {
    pub const ALL: [Self; 2] = [Self::NewtonMetre, Self::MillinewtonMetre];

    pub const fn symbol(self) -> &'static str {
        ["N·m", "mN·m"][self as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn index_is_the_position_in_the_one_order() {
        for (i, axis) in Axis::ALL.into_iter().enumerate() {
            assert_eq!(axis.index(), i);
        }
    }

    #[test]
    fn some_axes_are_picked_and_put_back_in_order() {
        let axes: Axes = [Axis::Mz, Axis::Fx].into_iter().collect();
        assert_eq!((axes.to_string().as_str(), axes.count()), ("Fx, Mz", 2));
        assert_eq!(axes.columns(), ["fx_n", "mz_nm"]);
        assert_eq!(axes.of(&[1, 2, 3, 4, 5, 6]), [1, 6]);
        assert_eq!(axes.spread(vec![1, 6], &0), Some([1, 0, 0, 0, 0, 6]));
        assert_eq!(axes.spread(vec![1, 6, 7], &0), None);
        assert!(Axes::ALL.contain(axes) && !axes.contain(Axes::ALL) && axes.contain(Axes::NONE));
        assert_eq!(Axes::ALL.without(axes).to_string(), "Fy, Fz, Mx, My");
        assert!(axes.and(Axes::ALL.without(axes)).is_empty());
    }
}
