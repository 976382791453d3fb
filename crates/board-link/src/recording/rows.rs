//! Formatting of frames as lines of a log.
//!
//! ```text
//! t_s,s1,…,s8,[fx_n,…,mz_nm,]index,missing,dropped,HEALTH,sync,sync_s,flags  readings [and forces]
//! t_s,fx_n,…,mz_nm,index,missing,dropped,HEALTH,sync,sync_s,flags            wrenches of the board
//! t_s,s1,…,s8,[fx_n,…,mz_nm,]flags                                           the original board
//! ```
//!
//! Behind a base station in API mode, `rssi_dbm` precedes the flags. HEALTH is
//! `temperature_c,supply_v,vrefint,dark1,…,dark8`: given in the first row after a report, about
//! once a second, and empty elsewhere, except for the temperature, which is repeated. `vrefint` and
//! `dark` are in steps. `sync` and `sync_s` are number and time (clock of `t_s`) of a sync edge, in
//! the row after it.
//!
//! `missing` counts the frames lost between this row and the previous one; `dropped` is the board's
//! own count, which wraps at 256. `flags` is empty for a regular row. Flags are `s3:saturated` and
//! `s3:range` as in the output of `convert`, `late` for a frame that came after a later one was
//! written, `skewed` if the channels could not be aligned to a common time, `restart` if the board
//! has restarted, `untared` and `unfiltered` while the tare and the clock of the forces were still
//! being determined: these forces come from the calibration alone, later ones match `convert` with
//! a causal low-pass. `mark1`, `mark2`, … are marks set by the user.
//!
//! With a reference sensor, `fx_n` … `mz_nm` are its wrench, from the sample closest in time to the frame, or empty if
//! none is close or the sensor reports an error. More columns precede the flags: `ref_index` and `ref_status`, the
//! sample's number and the sensor's status word; `ref_missing`, the samples lost since the sample of the previous row;
//! `ref_t_s`, the sample's time on the clock of `t_s`; and `ref_t_error_s`, the error of that time, without the
//! constant parts of both delays. If blocks of time are labelled, as planned loads are, `group` precedes the flags.

use std::collections::VecDeque;

use super::forces::{Force, LiveForces, RunningForces, UnsuitableCalibration};
use super::reception::{BoardFrame, Measured};
use super::reference::{BesideRow, ReferenceBeside};
use super::sequence::BoardEdge;
use super::simultaneous::Simultaneous;
use forces::ForceError;
use shared_proto::{CHANNELS, COUNTS_PER_LSB, Health};
use shell_data::block::FrameLabel;
use shell_data::escape::csv_field;
use shell_data::wrench::Axes;

#[derive(Clone, Debug, Default)]
pub(crate) struct Annotations {
    /// Pending marks, each for the first row from this frame on.
    pub(crate) marks: VecDeque<(i64, u32)>,
    pub(crate) labels: Vec<FrameLabel>,
    /// Index of the first frame that may still be labelled.
    pub(crate) settled: Option<i64>,
}

#[derive(Clone, Debug)]
pub(crate) struct RowWriter {
    /// True for readings, false for wrenches of the board.
    holds_readings: bool,
    is_numbered: bool,
    pub(crate) forces: Option<RunningForces>,
    last_index: Option<i64>,
    has_labels: bool,
    simultaneous: Simultaneous,
    reference: Option<Axes>,
    has_rssi: bool,
    temperature_c: Option<f64>,
}

impl RowWriter {
    /// Creates a writer for frames like `first`. `numbered` frames have sequence numbers, `forces`
    /// adds a calibration's forces, `as_sampled` leaves the channels at their sampling times,
    /// `has_labels` adds a column for labels, and the axes of a `reference` replace the forces.
    /// Fails with [`UnsuitableCalibration`] if the calibration does not suit the frames.
    pub(crate) fn new(
        first: &BoardFrame,
        numbered: bool,
        forces: Option<LiveForces>,
        as_sampled: bool,
        has_labels: bool,
        reference: Option<Axes>,
    ) -> Result<Self, UnsuitableCalibration> {
        let holds_readings = first.measured.readings().is_some();
        let forces = forces.map(RunningForces::new).transpose()?;
        if forces.is_some() && !holds_readings {
            return Err(UnsuitableCalibration::Wrenches);
        }
        Ok(Self {
            holds_readings,
            is_numbered: numbered || !holds_readings,
            forces,
            last_index: None,
            has_rssi: first.rssi_dbm.is_some(),
            reference,
            simultaneous: Simultaneous::new(as_sampled),
            has_labels,
            temperature_c: None,
        })
    }

    pub(crate) fn header(&self) -> String {
        let mut names = vec!["t_s".to_owned()];
        if self.holds_readings {
            names.extend((1..=CHANNELS).map(|channel| format!("s{channel}")));
        }
        names.extend(self.axes().columns().into_iter().map(str::to_owned));
        if self.is_numbered {
            let numbers = ["index", "missing", "dropped", "temperature_c", "supply_v", "vrefint"];
            names.extend(numbers.map(str::to_owned));
            names.extend((1..=CHANNELS).map(|channel| format!("dark{channel}")));
            names.extend(["sync", "sync_s"].map(str::to_owned));
        }
        if self.has_rssi {
            names.push("rssi_dbm".to_owned());
        }
        if self.reference.is_some() {
            names.extend(REFERENCE.map(str::to_owned));
        }
        if self.has_labels {
            names.push("group".to_owned());
        }
        names.push("flags".to_owned());
        names.join(",") + "\n"
    }

    fn axes(&self) -> Axes {
        match &self.forces {
            _ if !self.holds_readings => Axes::ALL,
            _ if self.reference.is_some() => self.reference.unwrap_or(Axes::NONE),
            Some(forces) => forces.axes(),
            None => Axes::NONE,
        }
    }

    /// Appends the rows of a batch of frames, sorted by index, and empties the batch. Until `ended`, the last frames
    /// may wait. Returns the number of frames that do not match the columns.
    pub(crate) fn write(
        &mut self,
        frames: &mut Vec<BoardFrame>,
        ended: bool,
        annotations: &mut Annotations,
        mut reference: Option<&mut ReferenceBeside>,
        text: &mut Vec<u8>,
    ) -> Result<u64, ForceError> {
        frames.sort_by_key(|frame| frame.index);
        let before = frames.len();
        frames.retain(|frame| frame.measured.readings().is_some() == self.holds_readings);
        let other_content = (before - frames.len()) as u64;
        let frames = match self.is_numbered {
            true => self.simultaneous.take(frames.drain(..), ended),
            false => std::mem::take(frames),
        };
        let forces = self.forces.as_mut().map(|forces| forces.of(&frames)).transpose()?;
        let forces = forces.unwrap_or_default();
        for (row, frame) in frames.into_iter().enumerate() {
            let step = self.last_index.map(|last| frame.index - last);
            let is_late = step.is_some_and(|step| step < 0);
            if !is_late {
                self.last_index = Some(frame.index);
            }
            write_time(frame.time_us, text);
            match frame.measured {
                Measured::Readings(values) => write_numbers(&values, text),
                Measured::Wrench(values) => write_numbers(&values, text),
            }
            let force = forces.get(row);
            let beside = reference.as_mut().map(|reference| reference.beside(&frame));
            if let Some(axes) = self.reference {
                write_reference_wrench(axes, beside.as_ref().and_then(Option::as_ref), text);
            } else if let Some(force) = force {
                write_numbers(&self.axes().of(&force.wrench), text);
            }
            if self.is_numbered {
                let missing = step.map_or(0, |step| (step - 1).max(0));
                text.extend_from_slice(
                    format!(",{},{missing},{}", frame.index, frame.dropped).as_bytes(),
                );
                write_health(frame.health.as_ref(), &mut self.temperature_c, text);
                write_edge(frame.edge.as_ref(), text);
            }
            if self.has_rssi {
                let rssi = frame.rssi_dbm.map_or_else(String::new, |dbm| dbm.to_string());
                text.extend_from_slice(format!(",{rssi}").as_bytes());
            }
            if self.reference.is_some() {
                write_reference(beside.flatten().as_ref(), text);
            }
            if self.has_labels {
                let labels = &annotations.labels;
                let is_in = |of: &&FrameLabel| (of.from..=of.until).contains(&frame.index);
                let label = labels.iter().find(is_in).map_or("", |of| &of.group);
                text.extend_from_slice(format!(",{}", csv_field(label)).as_bytes());
            }
            text.push(b',');
            let mut flags = row_flags(&frame, force, is_late);
            while let Some(&(index, number)) = annotations.marks.front()
                && frame.index >= index
            {
                annotations.marks.pop_front();
                flags.push(format!("mark{number}"));
            }
            text.extend_from_slice(flags.join(" ").as_bytes());
            text.push(b'\n');
        }
        Ok(other_content)
    }
}

const REFERENCE: [&str; 5] = ["ref_index", "ref_missing", "ref_status", "ref_t_s", "ref_t_error_s"];

fn write_reference_wrench(axes: Axes, beside: Option<&BesideRow>, text: &mut Vec<u8>) {
    match beside.and_then(|row| row.wrench) {
        Some(wrench) => write_numbers(&axes.of(&wrench), text),
        None => text.extend(std::iter::repeat_n(b',', axes.count())),
    }
}

fn write_reference(beside: Option<&BesideRow>, text: &mut Vec<u8>) {
    let Some(row) = beside else { return text.extend([b','; REFERENCE.len()]) };
    text.extend_from_slice(format!(",{},{},{},", row.number, row.missing, row.status).as_bytes());
    write_time(row.time_us, text);
    text.push(b',');
    write_time(row.error_us, text);
}

pub fn write_time(time_us: i64, text: &mut Vec<u8>) {
    let sign = if time_us < 0 { "-" } else { "" };
    let (whole, part) = (time_us.unsigned_abs() / 1_000_000, time_us.unsigned_abs() % 1_000_000);
    text.extend_from_slice(format!("{sign}{whole}.{part:06}").as_bytes());
}

/// Writes numbers with the fewest digits that read back exactly.
fn write_numbers(values: &[f64], text: &mut Vec<u8>) {
    let mut digits = zmij::Buffer::new();
    for &value in values {
        text.push(b',');
        let digits = digits.format(value);
        text.extend_from_slice(digits.strip_suffix(".0").unwrap_or(digits).as_bytes());
    }
}

/// Writes the health fields, empty without a report except for the last temperature.
fn write_health(health: Option<&Health>, temperature_c: &mut Option<f64>, text: &mut Vec<u8>) {
    let mut write = |value: Option<f64>| match value {
        Some(value) => write_numbers(&[value], text),
        None => text.push(b','),
    };
    let told = health.and_then(|health| health.vitals.temperature_cdeg);
    *temperature_c = told.map(|hundredths| f64::from(hundredths) / 100.0).or(*temperature_c);
    write(*temperature_c);
    let Some(Health { vitals, dark, .. }) = health else {
        return text.extend([b','; 2 + CHANNELS]);
    };
    let steps = |counts: u16| f64::from(counts) / f64::from(COUNTS_PER_LSB);
    write(vitals.supply_mv.map(|mv| f64::from(mv) / 1000.0));
    write(vitals.reference.map(steps));
    write_numbers(&dark.map(steps), text);
}

fn write_edge(edge: Option<&BoardEdge>, text: &mut Vec<u8>) {
    let Some(BoardEdge { number, time_us }) = edge else { return text.extend(b",,") };
    text.extend_from_slice(format!(",{number},").as_bytes());
    write_time(*time_us, text);
}

pub fn row_flags(frame: &BoardFrame, force: Option<&Force>, is_late: bool) -> Vec<String> {
    let words = [
        (force.is_some_and(|force| force.untared), "untared"),
        (force.is_some_and(|force| force.unfiltered), "unfiltered"),
        (frame.skewed, "skewed"),
        (frame.restarted, "restart"),
        (is_late, "late"),
    ];
    let words = words.into_iter().filter(|(applies, _)| *applies);
    let mut flags: Vec<String> = words.map(|(_, word)| word.to_owned()).collect();
    let out_of_range = force.map_or(0, |force| force.out_of_range);
    for channel in 0..CHANNELS {
        if out_of_range >> channel & 1 == 1 {
            flags.push(format!("s{}:range", channel + 1));
        }
        if frame.saturated >> channel & 1 == 1 {
            flags.push(format!("s{}:saturated", channel + 1));
        }
    }
    flags
}
