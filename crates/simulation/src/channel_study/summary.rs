//! Summary of a channel: its plateau, its energy, and diagnostics of their reliability.

use beam_channel::{Model, Setup, SetupError, Side, Wall};
use serde::Serialize;

/// A channel in a few figures. Pairs are for the left and the right wall.
#[derive(Clone, Debug, Serialize)]
pub struct ChannelSummary {
    pub width_m: f64,
    /// Maximum deflection of the tips by a body in the middle, m; negative without contact.
    pub deflection_m: f64,
    /// Position of the body's middle when it touches the first beam, m past that beam.
    pub first_contact_m: Option<f64>,
    pub last_contact_m: Option<f64>,
    /// First and last position in which the body is wholly among the beams, m.
    pub plateau_m: Option<[f64; 2]>,
    /// Mean drag on the plateau, N; zero without contact, `None` without a plateau.
    pub mean_drag_n: Option<f64>,
    pub peak_drag_n: Option<f64>,
    pub peak_x_m: Option<f64>,
    pub minimum_drag_n: Option<f64>,
    pub minimum_x_m: Option<f64>,
    pub mean_contacts: Option<[f64; 2]>,
    pub min_contacts: Option<[u32; 2]>,
    pub max_contacts: Option<[u32; 2]>,
    pub energy_j: f64,
    /// Mean drag from the first contact to the last, N: the window of a trial.
    pub crossing_drag_n: f64,
    pub remarks: Vec<ChannelDiagnostic>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, thiserror::Error)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum ChannelDiagnostic {
    #[error(
        "the body reaches past the line of the bases, and beams turn past 90°: the model is not valid there"
    )]
    PastRightAngle,
    #[error("tips snap across a part of the body on which they cannot rest")]
    Snaps,
    #[error(
        "the body is yawed so far that it meets the beams' faces before their tips: not in the model"
    )]
    FacesFirst,
    #[error(
        "beams bend until their faces touch the body: the true drag is larger (`--beam plate`)"
    )]
    FaceContact,
    #[error("the channel is shorter than the body: there is no plateau")]
    NoPlateau,
    #[error(
        "the plateau is shorter than the spacing of the beams: its figures are those of a longer channel"
    )]
    ShortPlateau,
}

/// Computes the summary of a channel.
///
/// # Errors
/// [`SetupError`] if the set-up is invalid, or the body jams.
pub fn summarise(setup: &Setup) -> Result<ChannelSummary, SetupError> {
    Ok(ChannelSummary::new(&Model::new(setup)?))
}

impl ChannelSummary {
    pub fn new(model: &Model) -> Self {
        let setup = model.setup();
        let sides = || Wall::BOTH.into_iter().filter_map(|wall| model.side(wall));
        let extent = model.extent_m();
        let plateau = model.plateau();
        let free = extent.is_none();
        let or_nothing = |value: Option<f64>| if free { Some(0.0) } else { value };
        let any = |test: fn(&Side) -> bool| sides().any(test);
        let short = plateau.is_some_and(|plateau| {
            plateau.extent_m[1] - plateau.extent_m[0] < setup.channel.pitch_m
        });
        let remarks = [
            (any(Side::turns_past_a_right_angle), ChannelDiagnostic::PastRightAngle),
            (any(|side| side.snaps), ChannelDiagnostic::Snaps),
            (any(Side::meets_faces_first), ChannelDiagnostic::FacesFirst),
            (any(Side::beams_lie_against_body), ChannelDiagnostic::FaceContact),
            (!free && plateau.is_none(), ChannelDiagnostic::NoPlateau),
            (short, ChannelDiagnostic::ShortPlateau),
        ];
        let no_contacts = free.then_some([0; 2]);
        let energy_j = model.energy();
        Self {
            width_m: setup.channel.width_m,
            deflection_m: setup.deflection_m(),
            first_contact_m: extent.map(|[first, _]| first),
            last_contact_m: extent.map(|[_, last]| last),
            plateau_m: plateau.map(|plateau| plateau.extent_m),
            mean_drag_n: or_nothing(plateau.map(|plateau| plateau.mean_drag_n)),
            peak_drag_n: or_nothing(plateau.map(|plateau| plateau.peak.drag_n)),
            peak_x_m: plateau.map(|plateau| plateau.peak.x_m),
            minimum_drag_n: or_nothing(plateau.map(|plateau| plateau.minimum.drag_n)),
            minimum_x_m: plateau.map(|plateau| plateau.minimum.x_m),
            mean_contacts: plateau.map(|all| all.mean_contacts).or(free.then_some([0.0; 2])),
            min_contacts: plateau.map(|plateau| plateau.min_contacts).or(no_contacts),
            max_contacts: plateau.map(|plateau| plateau.max_contacts).or(no_contacts),
            energy_j,
            crossing_drag_n: extent.map_or(0.0, |[first, last]| energy_j / (last - first)),
            remarks: remarks.into_iter().filter_map(|(is, remark)| is.then_some(remark)).collect(),
        }
    }
}
