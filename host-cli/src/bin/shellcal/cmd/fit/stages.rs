//! The time that each stage of a fit takes.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use shell_data::lock::lock;

#[derive(Debug)]
pub(super) struct StageTimes(Mutex<Running>);

#[derive(Debug)]
struct Running {
    stage: &'static str,
    since: Instant,
    /// Total time of each ended stage, in the order in which the stages first started.
    ended: Vec<(&'static str, Duration)>,
}

impl Running {
    fn end(&mut self) {
        let now = Instant::now();
        let time = now - std::mem::replace(&mut self.since, now);
        match self.ended.iter_mut().find(|(stage, _)| *stage == self.stage) {
            Some((_, sum)) => *sum += time,
            None => self.ended.push((self.stage, time)),
        }
    }
}

impl StageTimes {
    pub(super) fn new(stage: &'static str) -> Self {
        Self(Mutex::new(Running { stage, since: Instant::now(), ended: Vec::new() }))
    }

    /// Ends the running stage and starts another, which may have run before.
    pub(super) fn start(&self, stage: &'static str) {
        let mut running = lock(&self.0);
        running.end();
        running.stage = stage;
    }

    pub(super) fn lines(&self) -> Vec<String> {
        let mut running = lock(&self.0);
        running.end();
        let total: f64 = running.ended.iter().map(|(_, time)| time.as_secs_f64()).sum();
        let line = |(stage, time): &(&str, Duration)| {
            let seconds = time.as_secs_f64();
            format!("{stage}: {seconds:.3} s, {:.0} %", 100.0 * seconds / total)
        };
        running.ended.iter().map(line).collect()
    }
}
