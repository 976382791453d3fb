//! The wrench on the shell: axis order, names and units, written down once.
//!
//! Frame: x forward, y left, z up. Forces in N, moments in N·m. *Drag* is −Fx, *lift* is Fz.

/// One axis of the wrench, in the order used everywhere.
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
    /// All six axes, in order.
    pub const ALL: [Axis; 6] = [Axis::Fx, Axis::Fy, Axis::Fz, Axis::Mx, Axis::My, Axis::Mz];

    /// Position in the order of [`Axis::ALL`].
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The name that people read: `Fx` … `Mz`.
    pub const fn name(self) -> &'static str {
        match self {
            Axis::Fx => "Fx",
            Axis::Fy => "Fy",
            Axis::Fz => "Fz",
            Axis::Mx => "Mx",
            Axis::My => "My",
            Axis::Mz => "Mz",
        }
    }

    /// The name of a column or field that leaves the program, with its SI unit: `fx_n` … `mz_nm`.
    pub const fn column(self) -> &'static str {
        match self {
            Axis::Fx => "fx_n",
            Axis::Fy => "fy_n",
            Axis::Fz => "fz_n",
            Axis::Mx => "mx_nm",
            Axis::My => "my_nm",
            Axis::Mz => "mz_nm",
        }
    }

    /// The SI unit as people read it.
    pub const fn unit(self) -> &'static str {
        if self.is_moment() { "N·m" } else { "N" }
    }

    /// Whether the axis is a moment.
    pub const fn is_moment(self) -> bool {
        matches!(self, Axis::Mx | Axis::My | Axis::Mz)
    }
}

/// One value per axis, in the order of [`Axis::ALL`].
pub type PerAxis<T> = [T; 6];

/// The unit of moment columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MomentUnit {
    /// N·m
    NewtonMetre,
    /// mN·m, which is also N·mm
    MillinewtonMetre,
}

impl MomentUnit {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::NewtonMetre, Self::MillinewtonMetre];

    /// The symbol of the unit.
    pub const fn symbol(self) -> &'static str {
        match self {
            Self::NewtonMetre => "N·m",
            Self::MillinewtonMetre => "mN·m",
        }
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
}
