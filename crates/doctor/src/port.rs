//! Checks of a port before any transmission.

use crate::Finding;
use board_link::{LinkError, PortState};

/// Maximum latency. With 16 ms, an adapter delivers a slow stream in bursts, 62 times a second.
const LATENCY_MS: u32 = 2;

pub fn check_port(port: &PortState) -> Vec<Finding> {
    let mut findings = vec![match &port.refusal {
        None => Finding::fine("port", format!("`{}` can be opened", port.port)),
        Some(refusal) => refused(port, refusal),
    }];
    if let Some(latency_ms) = port.latency_ms {
        let seen = format!("the USB adapter keeps bytes back for up to {latency_ms} ms");
        findings.push(match latency_ms <= LATENCY_MS {
            true => Finding::fine("latency-timer", seen),
            false => Finding::warning(
                "latency-timer",
                format!("{seen}, so frames come in bursts"),
                match &port.latency_file {
                    Some(file) => format!("`echo 1 | sudo tee {}`", file.display()),
                    None => "set the latency timer of the adapter to 1 ms".to_owned(),
                },
            ),
        });
    }
    findings
}

fn refused(port: &PortState, refusal: &LinkError) -> Finding {
    let seen = refusal.to_string();
    match refusal {
        LinkError::Missing { .. } => {
            let advice = "plug the adapter in; `shellcal board` lists the ports there are";
            Finding::fault("port-missing", seen, advice)
        }
        LinkError::Denied { .. } => {
            let group = port.group.as_deref().unwrap_or("dialout");
            let advice = match port.in_group {
                Some(true) => format!(
                    "you are in group `{group}`, so the port's own mode is at fault: \
                     `sudo chmod g+rw {}`",
                    port.port
                ),
                _ => format!(
                    "join the group that may: `sudo usermod -aG {group} $USER`, then log in again"
                ),
            };
            Finding::fault("port-permission", seen, advice)
        }
        LinkError::Busy { .. } => {
            let (seen, advice) = match &port.holder {
                Some((name, id)) => (
                    format!("port `{}` is in use by `{name}` ({id})", port.port),
                    format!("end it, by `kill {id}` if need be"),
                ),
                None => (seen, "end that program; `sudo fuser -v PORT` names it".to_owned()),
            };
            Finding::fault("port-in-use", seen, advice)
        }
        _ => Finding::fault("port-open", seen, "name a serial port; `shellcal board` lists them"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FindingSeverity;

    fn port(refusal: Option<LinkError>) -> PortState {
        PortState { port: "/dev/ttyUSB0".to_owned(), refusal, ..PortState::default() }
    }

    fn named() -> String {
        "/dev/ttyUSB0".to_owned()
    }

    #[test]
    fn a_port_that_opens_at_once_is_fine() {
        let port = PortState { latency_ms: Some(1), ..port(None) };
        assert!(check_port(&port).iter().all(|finding| finding.severity == FindingSeverity::Fine));
    }

    #[test]
    fn a_denied_port_has_advice_for_access() {
        let denied = port(Some(LinkError::Denied(named())));
        let denied = PortState { group: Some("uucp".to_owned()), in_group: Some(false), ..denied };
        let [finding] = &check_port(&denied)[..] else { panic!("{denied:?}") };
        assert_eq!((finding.check, finding.severity), ("port-permission", FindingSeverity::Fault));
        assert!(finding.advice.as_ref().unwrap().contains("usermod -aG uucp"), "{finding:?}");
        let finding = &check_port(&PortState { in_group: Some(true), ..denied })[0];
        assert!(finding.advice.as_ref().unwrap().contains("chmod"), "{finding:?}");
    }

    #[test]
    fn the_program_that_has_the_port_is_named() {
        let busy = port(Some(LinkError::Busy(named())));
        let busy = PortState { holder: Some(("ModemManager".to_owned(), 812)), ..busy };
        let finding = &check_port(&busy)[0];
        assert_eq!(finding.check, "port-in-use");
        assert!(finding.seen.contains("`ModemManager` (812)"), "{finding:?}");
    }

    #[test]
    fn an_adapter_that_keeps_bytes_back_is_found() {
        let slow = PortState {
            latency_ms: Some(16),
            latency_file: Some("/sys/latency_timer".into()),
            ..port(None)
        };
        let finding = &check_port(&slow)[1];
        assert_eq!((finding.check, finding.severity), ("latency-timer", FindingSeverity::Warning));
        assert_eq!(finding.advice.as_deref(), Some("`echo 1 | sudo tee /sys/latency_timer`"));
    }
}
