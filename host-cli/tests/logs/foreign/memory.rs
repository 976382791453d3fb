//! Nine kinds of springs with memory, from a force to a displacement of about the same size.
//! Formulas from the literature, independent of the program's code.
use system_tests::random::Random;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Bouc (1967) and Wen, J. Eng. Mech. Div. 102, 249 (1976).
    BoucWen,
    /// Weighted plays (Krasnosel'skii & Pokrovskii, 1989), in axes other than the wrench's.
    PrandtlIshlinskii,
    /// Springs with sliding feet in parallel (Iwan, J. Appl. Mech. 33, 893, 1966), per channel.
    MaxwellSlip,
    /// A triangle of relays (Mayergoyz, Phys. Rev. Lett. 56, 1518, 1986), one per channel.
    Preisach,
    /// Dahl (1968): friction that approaches its limit exponentially after a reversal.
    Dahl,
    /// The standard linear solid: creep with two time constants, no friction.
    LinearSolid,
    /// Bristle friction that depends on speed (Canudas de Wit et al., IEEE Trans. Autom. Control 40, 419, 1995).
    LuGre,
    /// One play per direction, each with its own width: a joint with backlash.
    Backlash,
    /// Clearance in the middle, which a very small force crosses.
    Clearance,
}

impl Kind {
    pub(crate) const ALL: [Self; 9] = [
        Self::BoucWen,
        Self::PrandtlIshlinskii,
        Self::MaxwellSlip,
        Self::Preisach,
        Self::Dahl,
        Self::LinearSolid,
        Self::LuGre,
        Self::Backlash,
        Self::Clearance,
    ];

    /// True if each channel remembers its own displacement.
    pub(crate) fn per_channel(self) -> bool {
        matches!(self, Self::MaxwellSlip | Self::Preisach)
    }

    /// Returns a random spring for loads of order 1.
    pub(crate) fn draw(self, random: &mut Random) -> Box<dyn Spring> {
        let mut between = |low: f64, high: f64| low + (high - low) * random.unit();
        match self {
            Self::BoucWen => {
                let yielding = between(0.05, 0.4);
                let exponent = between(1.0, 2.0);
                let share = between(0.4, 0.9);
                let limit = f64::powf(yielding, -exponent);
                Box::new(BoucWen {
                    elastic: between(0.75, 0.95),
                    beta: share * limit,
                    gamma: (1.0 - share) * limit,
                    exponent,
                    state: [0.0; 3],
                })
            }
            Self::PrandtlIshlinskii => {
                let (share, decay) = (between(0.05, 0.25), between(0.1, 0.5));
                let weight = |k: u32| f64::exp(-0.05 * f64::from(k) / decay);
                let sum: f64 = (1..=12).map(weight).sum();
                let play = |k: u32| (0.05 * f64::from(k), share * weight(k) / sum, 0.0);
                Box::new(Plays { immediate: 1.0 - share, plays: (1..=12).map(play).collect() })
            }
            Self::MaxwellSlip => {
                let share = between(0.05, 0.3);
                let foot = |k: u32| (share / 8.0, share / 8.0 * 0.08 * f64::from(k), 0.0);
                let feet = (1..=8).map(foot).collect();
                Box::new(MaxwellSlip { elastic: 1.0 - share, feet, at: [0.0; 2] })
            }
            Self::Preisach => {
                Box::new(Preisach::new(between(0.05, 0.25), between(0.1, 0.5), between(1.5, 2.5)))
            }
            Self::Dahl => Box::new(Dahl {
                stiffness: between(0.1, 0.6),
                friction: between(0.02, 0.1),
                state: [0.0; 3],
            }),
            Self::LinearSolid => {
                let branch = |low: f64, high: f64, random: &mut Random| {
                    let time_s = low * f64::powf(high / low, random.unit());
                    (0.02 + 0.1 * random.unit(), time_s, 0.0)
                };
                let branches = vec![branch(0.15, 1.0, random), branch(1.0, 10.0, random)];
                Box::new(LinearSolid { branches })
            }
            Self::LuGre => {
                let kinetic = between(0.02, 0.1);
                Box::new(LuGre {
                    stiffness: between(2.0, 10.0),
                    kinetic,
                    stick: kinetic * between(1.1, 1.6),
                    stribeck: between(0.05, 0.5),
                    damping: between(0.0, 0.005),
                    viscous: between(0.0, 0.01),
                    state: [0.0; 3],
                })
            }
            Self::Backlash => {
                let (width, share) = (between(0.02, 0.1), between(0.2, 0.6));
                Box::new(Plays { immediate: 1.0 - share, plays: vec![(width, share, 0.0)] })
            }
            Self::Clearance => Box::new(Clearance { gap: between(0.05, 0.2), force: 0.02 }),
        }
    }
}

pub(crate) trait Spring {
    /// Returns the displacement after `force` was reached in `step_s`.
    fn displacement(&mut self, force: f64, step_s: f64) -> f64;
}

const STEP: f64 = 0.004;

/// Follows a force from `state` (force, displacement, inner force) by increments. `slope` is the
/// derivative of the inner force by displacement, by direction and inner force. The force is
/// `elastic` times the displacement plus the inner force.
fn follow(state: &mut [f64; 3], force: f64, elastic: f64, slope: impl Fn(f64, f64) -> f64) -> f64 {
    let steps = ((force - state[0]).abs() / STEP).ceil().max(1.0);
    let part = (force - state[0]) / steps;
    for _ in 0..steps as usize {
        let inner = slope(part.signum(), state[2]);
        let way = part / (elastic + inner);
        state[1] += way;
        state[2] += inner * way;
    }
    state[0] = force;
    state[1]
}

/// F = α x + (1 − α) z, dz = (1 − (β sgn(z dx) + γ) |z|ⁿ) dx.
struct BoucWen {
    elastic: f64,
    beta: f64,
    gamma: f64,
    exponent: f64,
    state: [f64; 3],
}

impl Spring for BoucWen {
    fn displacement(&mut self, force: f64, _step_s: f64) -> f64 {
        let Self { elastic, beta, gamma, exponent, ref mut state } = *self;
        let share = 1.0 - elastic;
        follow(state, force, elastic, |way, inner| {
            let z: f64 = inner / share;
            let turned = beta * (z * way).signum() + gamma;
            share * (1.0 - turned * z.abs().powf(exponent)).max(0.0)
        })
    }
}

/// F = x + f, df = σ (1 − f sgn(dx) / F_c) dx.
struct Dahl {
    stiffness: f64,
    friction: f64,
    state: [f64; 3],
}

impl Spring for Dahl {
    fn displacement(&mut self, force: f64, _step_s: f64) -> f64 {
        let Self { stiffness, friction, ref mut state } = *self;
        follow(state, force, 1.0, |way, inner| stiffness * (1.0 - inner * way / friction).max(0.0))
    }
}

/// F = x + σ₀ z + σ₁ ż + σ₂ v, ż = v − σ₀ |v| z / g(v), g(v) = F_c + (F_s − F_c) exp(−(v/v_s)²).
struct LuGre {
    /// σ₀, σ₁ and σ₂, the latter two in s.
    stiffness: f64,
    damping: f64,
    viscous: f64,
    kinetic: f64,
    stick: f64,
    /// v_s, 1/s.
    stribeck: f64,
    state: [f64; 3],
}

impl Spring for LuGre {
    fn displacement(&mut self, force: f64, step_s: f64) -> f64 {
        const PARTS: usize = 10;
        let [mut x, mut z, mut v] = self.state;
        let h = step_s / PARTS as f64;
        for _ in 0..PARTS {
            let drive = force - x - self.stiffness * z;
            let slower = (self.stick - self.kinetic) * (-(v / self.stribeck).powi(2)).exp();
            // Share of the motion that bends the bristles; 0 if they slide.
            let bends = 1.0 - self.stiffness * z * drive.signum() / (self.kinetic + slower);
            // Balance of forces at the end of the step.
            let resists = h + self.stiffness * h * bends + self.damping * bends + self.viscous;
            v = drive / resists.max(h);
            x += h * v;
            z += h * v * bends;
        }
        self.state = [x, z, v];
        x
    }
}

/// x = F + c clamp(F / F₀, −1, 1).
struct Clearance {
    gap: f64,
    force: f64,
}

impl Spring for Clearance {
    fn displacement(&mut self, force: f64, _step_s: f64) -> f64 {
        force + self.gap * (force / self.force).clamp(-1.0, 1.0)
    }
}

/// x = h₀ F + Σ hₖ pₖ, pₖ the play of half-width rₖ: (rₖ, hₖ, pₖ).
struct Plays {
    immediate: f64,
    plays: Vec<(f64, f64, f64)>,
}

impl Spring for Plays {
    fn displacement(&mut self, force: f64, _step_s: f64) -> f64 {
        let late = self.plays.iter_mut().map(|(width, share, play)| {
            *play = play.clamp(force - *width, force + *width);
            *share * *play
        });
        self.immediate * force + late.sum::<f64>()
    }
}

/// F = k₀ x + Σ fₖ; a foot of stiffness kₖ slides at its limit: (kₖ, limit, fₖ).
struct MaxwellSlip {
    elastic: f64,
    feet: Vec<(f64, f64, f64)>,
    at: [f64; 2],
}

impl Spring for MaxwellSlip {
    fn displacement(&mut self, force: f64, _step_s: f64) -> f64 {
        let steps = ((force - self.at[0]).abs() / STEP).ceil().max(1.0);
        let part = (force - self.at[0]) / steps;
        for _ in 0..steps as usize {
            let sticks = |foot: &(f64, f64, f64)| foot.2 * part.signum() < foot.1;
            let stuck: f64 = self.feet.iter().filter(|f| sticks(f)).map(|foot| foot.0).sum();
            let way = part / (self.elastic + stuck);
            self.at[1] += way;
            for (stiffness, limit, held) in &mut self.feet {
                *held = (*held + *stiffness * way).clamp(-*limit, *limit);
            }
        }
        self.at[0] = force;
        self.at[1]
    }
}

/// x = (1 − h) F + h Σ μ(α, β) R_αβ(F), relays up at α and down at β ≤ α.
struct Preisach {
    share: f64,
    range: f64,
    /// α, β, weight, and true if up.
    relays: Vec<(f64, f64, f64, bool)>,
}

impl Preisach {
    const LEVELS: u32 = 48;

    fn new(share: f64, width: f64, range: f64) -> Self {
        let level = |k: u32| range * (2.0 * (f64::from(k) + 0.5) / f64::from(Self::LEVELS) - 1.0);
        let mut relays = Vec::new();
        for a in 0..Self::LEVELS {
            for b in 0..=a {
                let apart = (level(a) - level(b)) / width;
                relays.push((level(a), level(b), (-apart).exp(), level(a) + level(b) < 0.0));
            }
        }
        let sum: f64 = relays.iter().map(|relay| relay.2).sum();
        relays.iter_mut().for_each(|relay| relay.2 /= sum);
        Self { share, range, relays }
    }
}

impl Spring for Preisach {
    fn displacement(&mut self, force: f64, _step_s: f64) -> f64 {
        let relays = self.relays.iter_mut().map(|(up, down, weight, is_up)| {
            *is_up = force >= *up || (*is_up && force > *down);
            if *is_up { *weight } else { -*weight }
        });
        // If all relays are up or all are down, the displacement is ± the range.
        (1.0 - self.share) * force + self.share * self.range * relays.sum::<f64>()
    }
}

/// x = F + Σ cₖ lₖ, τₖ dlₖ/dt = F − lₖ: (cₖ, τₖ, lₖ).
struct LinearSolid {
    branches: Vec<(f64, f64, f64)>,
}

impl Spring for LinearSolid {
    fn displacement(&mut self, force: f64, step_s: f64) -> f64 {
        let late = self.branches.iter_mut().map(|(share, time_s, state)| {
            *state += -f64::exp_m1(-step_s / *time_s) * (force - *state);
            *share * *state
        });
        force + late.sum::<f64>()
    }
}
