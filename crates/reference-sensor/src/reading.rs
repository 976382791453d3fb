//! Threads that read a reference until they are stopped.

use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpStream, ToSocketAddrs, UdpSocket};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use board_link::recording::{ReferenceInput, ReferenceSample, ReferenceState};
use board_link::{Connection, FlowControl, PortOptions};
use shell_data::Axes;
use shell_data::lock::lock;

use super::ft300::{self, FRAME_SIZE, FrameReader};
use super::lines::LineReader;
use super::page::{self, BoxSettings};
use super::rdt::{self, RdtArrival, RdtCommand, RdtRecord, RdtTracker, status};
use super::source::{ReferenceError, ReferenceSource};

/// Timeout for the first sample; a Python program takes a second to start.
const FIRST: Duration = Duration::from_secs(8);

const CONNECT: Duration = Duration::from_secs(3);

/// Timeout of a read: a thread notices within it that it should stop.
const WAIT: Duration = Duration::from_millis(100);

/// Silence after which the start request is sent again.
const SILENCE: Duration = Duration::from_secs(1);

/// Pause after each read: waking for each record at 1 kHz triples the processor time.
const PACE: Duration = Duration::from_millis(3);

/// Maximum size of a box's page, and of a line, bytes.
const LONGEST: usize = 1 << 18;

const FT300_BAUD: u32 = 19_200;

#[derive(Clone, Debug)]
struct Teller {
    samples: Sender<ReferenceSample>,
    state: Arc<Mutex<ReferenceState>>,
    axes: Arc<Mutex<Axes>>,
    stop: Arc<AtomicBool>,
}

impl Teller {
    fn goes_on(&self) -> bool {
        !self.stop.load(Ordering::Relaxed)
    }

    fn tell(&self, sample: ReferenceSample) {
        {
            let counts = &mut lock(&self.state).counts;
            counts.samples += 1;
            counts.restarts += u64::from(sample.restarted);
            counts.with_status += u64::from(sample.status != 0);
            counts.missing = sample.missing;
        }
        let _ = self.samples.send(sample);
    }

    fn end(&self, problem: impl ToString) {
        lock(&self.state).problem.get_or_insert(problem.to_string());
    }
}

impl ReferenceSource {
    /// Opens the reference, starts it, and waits for the first sample. Fails with
    /// [`ReferenceError`] if it cannot be opened, ends, or sends no sample in time.
    pub fn open(&self) -> Result<ReferenceInput, ReferenceError> {
        let (sender, samples) = channel();
        let (state, axes, stop): (Arc<Mutex<ReferenceState>>, Arc<Mutex<Axes>>, Arc<AtomicBool>) =
            Default::default();
        let name = self.to_string();
        let input = ReferenceInput {
            name: name.clone(),
            axes: Axes::ALL,
            samples,
            state: Arc::clone(&state),
            stop: Arc::clone(&stop),
        };
        let teller = Teller { samples: sender, state, axes, stop };
        let failed = |error: io::Error| self.refused(&error);
        let run: Box<dyn FnOnce(Teller) + Send> = match self {
            Self::NetFt { host, port, bias } => {
                let (socket, settings) = self.open_box(host, *port)?;
                let bias = *bias;
                *lock(&teller.axes) = Axes::ALL;
                Box::new(move |teller| read_box(&socket, &settings, bias, &teller))
            }
            Self::Ft300(port) => {
                let options = PortOptions {
                    port: port.clone(),
                    baud: FT300_BAUD,
                    flow_control: FlowControl::None,
                };
                let connection = options.open()?;
                *lock(&teller.axes) = Axes::ALL;
                Box::new(move |teller| read_ft300(connection, &teller))
            }
            Self::Command(command) => {
                let child = shell(command).spawn().map_err(failed)?;
                Box::new(move |teller| read_program(child, &teller))
            }
            Self::Tcp(at) => {
                let stream = self.connect(at)?;
                stream.set_read_timeout(Some(WAIT)).map_err(failed)?;
                Box::new(move |teller| match read_lines(stream, &teller) {
                    Ok(()) => teller.end("it has ended"),
                    Err(problem) => teller.end(problem),
                })
            }
        };
        let of_thread = teller.clone();
        let run = move || run(of_thread);
        thread::Builder::new().name("reference".to_owned()).spawn(run).map_err(failed)?;
        self.wait_for_first(input, &teller)
    }

    fn wait_for_first(
        &self,
        mut input: ReferenceInput,
        teller: &Teller,
    ) -> Result<ReferenceInput, ReferenceError> {
        let (started, source_name) = (Instant::now(), self.to_string());
        loop {
            let ReferenceState { counts, problem } = lock(&teller.state).clone();
            if counts.samples > 0 {
                input.axes = *lock(&teller.axes);
                return Ok(input);
            }
            if let Some(reason) = problem {
                return Err(ReferenceError::Ended { source_name, reason });
            }
            if started.elapsed() >= FIRST {
                let damaged = counts.damaged + counts.untimed;
                let more = match damaged {
                    0 => String::new(),
                    damaged => format!("; {damaged} pieces came that are none"),
                };
                return Err(ReferenceError::Silent { source_name, seconds: FIRST.as_secs(), more });
            }
            thread::sleep(Duration::from_millis(2));
        }
    }

    fn refused(&self, error: &impl ToString) -> ReferenceError {
        ReferenceError::Open { source_name: self.to_string(), reason: error.to_string() }
    }

    fn connect(&self, at: impl ToSocketAddrs) -> Result<TcpStream, ReferenceError> {
        connect(at).map_err(|error| self.refused(&error))
    }

    fn open_box(
        &self,
        host: &str,
        port: Option<u16>,
    ) -> Result<(UdpSocket, BoxSettings), ReferenceError> {
        let rdt_port = port.unwrap_or(rdt::PORT);
        let refused = |error: io::Error| self.refused(&error);
        let mut found = (host, rdt_port).to_socket_addrs().map_err(refused)?;
        let address = found.next().ok_or_else(|| self.refused(&"the host has no address"))?;
        let own: SocketAddr = match address {
            SocketAddr::V4(_) => ([0, 0, 0, 0], 0).into(),
            SocketAddr::V6(_) => ([0_u16; 8], 0).into(),
        };
        let socket = UdpSocket::bind(own).map_err(refused)?;
        socket.connect(address).map_err(refused)?;
        socket.set_read_timeout(Some(WAIT)).map_err(refused)?;
        // A box serves its page at port 80; `shellcal stream` may serve it at the number of its RDT port.
        let ports = [port.filter(|port| *port != rdt::PORT), Some(80), Some(rdt_port)];
        let mut reasons = Vec::new();
        for port in ports.into_iter().flatten() {
            match get_page(SocketAddr::new(address.ip(), port)) {
                Ok(page) => {
                    let source_name = self.to_string();
                    let settings = page::read(&page)
                        .map_err(|problem| ReferenceError::Page { source_name, problem })?;
                    return Ok((socket, settings));
                }
                Err(error) => reasons.push(format!("port {port}: {error}")),
            }
        }
        reasons.dedup();
        Err(ReferenceError::NoPage { source_name: self.to_string(), reason: reasons.join("; ") })
    }
}

fn connect(at: impl ToSocketAddrs) -> io::Result<TcpStream> {
    let mut last = io::Error::other("the host has no address");
    for address in at.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, CONNECT) {
            Ok(stream) => return Ok(stream),
            Err(error) => last = error,
        }
    }
    Err(last)
}

/// Gets a box's page by HTTP 1.0, in which the end of the connection ends the answer.
fn get_page(at: SocketAddr) -> io::Result<String> {
    let mut stream = connect(at)?;
    stream.set_read_timeout(Some(CONNECT))?;
    stream.set_write_timeout(Some(CONNECT))?;
    let request = format!(
        "GET /netftapi2.xml HTTP/1.0\r\nHost: {}\r\nAccept: */*\r\nConnection: close\r\n\r\n",
        at.ip()
    );
    stream.write_all(request.as_bytes())?;
    let mut answer = Vec::new();
    let deadline = Instant::now() + CONNECT;
    let mut buffer = [0; 4096];
    loop {
        match stream.read(&mut buffer) {
            Ok(0) => break,
            Ok(count) => answer.extend_from_slice(&buffer[..count]),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            // Some boxes leave the connection open until the read times out.
            Err(_) if answer.len() > 100 => break,
            Err(error) => return Err(error),
        }
        if answer.len() > LONGEST || Instant::now() > deadline {
            break;
        }
    }
    let answer = String::from_utf8_lossy(&answer);
    let status = answer.lines().next().unwrap_or_default().to_owned();
    match status.split(' ').nth(1) {
        Some("200") => Ok(answer.into_owned()),
        _ => Err(io::Error::other(format!("it answers `{status}`"))),
    }
}

fn read_box(socket: &UdpSocket, settings: &BoxSettings, bias: bool, teller: &Teller) {
    let (mut tracker, mut missing) = (RdtTracker::default(), 0_i64);
    let mut datagram = [0; 1 << 12];
    let send = |command: RdtCommand| {
        // Errors do not matter: a box that is off may refuse the request, which is repeated.
        let _ = socket.send(&command.encode());
    };
    if bias {
        send(RdtCommand::Bias);
    }
    send(RdtCommand::Start(0));
    let mut heard = Instant::now();
    while teller.goes_on() {
        let Ok(count) = socket.recv(&mut datagram) else {
            if heard.elapsed() >= SILENCE {
                send(RdtCommand::Start(0));
                heard = Instant::now();
            }
            thread::sleep(PACE);
            continue;
        };
        let mut count = Some(count);
        let is_pacing = socket.set_nonblocking(true).is_ok();
        while let Some(length) = count {
            let arrival = Instant::now();
            heard = arrival;
            match RdtRecord::decode_all(&datagram[..length]) {
                Some(records) => {
                    for record in records {
                        take_record(record, settings, arrival, &mut tracker, &mut missing, teller);
                    }
                }
                None => lock(&teller.state).counts.damaged += 1,
            }
            count = if is_pacing { socket.recv(&mut datagram).ok() } else { None };
        }
        if is_pacing && socket.set_nonblocking(false).is_err() {
            return teller.end("its socket is gone");
        }
        thread::sleep(PACE);
    }
    send(RdtCommand::Stop);
}

fn take_record(
    record: RdtRecord,
    settings: &BoxSettings,
    arrival: Instant,
    tracker: &mut RdtTracker,
    missing: &mut i64,
    teller: &Teller,
) {
    let (number, how) = tracker.place(record);
    match how {
        RdtArrival::Next(gap) => *missing += i64::from(gap),
        RdtArrival::Late => {
            *missing -= 1;
            lock(&teller.state).counts.late += 1;
        }
        RdtArrival::Duplicate => {
            lock(&teller.state).counts.duplicates += 1;
            return;
        }
        RdtArrival::Restarted => {}
    }
    let is_usable = record.status & status::ERROR == 0;
    teller.tell(ReferenceSample {
        number,
        tick: Some(number as f64),
        restarted: how == RdtArrival::Restarted,
        arrival,
        wrench: is_usable.then(|| settings.wrench(record.counts)),
        status: record.status,
        // The count is negative after a late record from before the run, which never counted as missing.
        missing: u64::try_from(*missing).unwrap_or(0),
    });
}

fn read_ft300(mut connection: Box<dyn Connection>, teller: &Teller) {
    let (mut frames, mut number, mut missing) = (FrameReader::default(), 0_i64, 0_u64);
    let mut buffer = [0; 1024];
    let mut asked = None::<Instant>;
    let mut heard = Instant::now();
    while teller.goes_on() {
        // A sensor that already streams ignores the request.
        if asked.is_none()
            || heard.elapsed() >= SILENCE && asked.is_some_and(|at| at.elapsed() >= SILENCE)
        {
            asked = Some(Instant::now());
            let _ = connection.write_all(&ft300::START);
        }
        let count = match connection.read(&mut buffer) {
            Ok(0) => return teller.end("its port is gone"),
            Ok(count) => count,
            Err(error) if is_pause(&error) => continue,
            Err(error) => return teller.end(format!("its port is gone: {error}")),
        };
        let arrival = Instant::now();
        for frame in frames.feed(&buffer[..count]) {
            heard = arrival;
            // Bytes before the first frame are the end of another, or the answer to the start.
            let lost = (frame.skipped + FRAME_SIZE / 2) / FRAME_SIZE;
            if number > 0 && frame.skipped > 0 {
                lock(&teller.state).counts.damaged += 1;
                missing += lost as u64;
                number += lost as i64;
            }
            number += 1;
            teller.tell(ReferenceSample {
                number,
                tick: Some(number as f64),
                restarted: false,
                arrival,
                wrench: Some(frame.wrench),
                status: 0,
                missing,
            });
        }
        thread::sleep(PACE);
    }
    // A burst of 0xff bytes ends the stream.
    let _ = connection.write_all(&[0xff; 50]);
}

fn is_pause(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), Interrupted | TimedOut | WouldBlock)
}

fn shell(command: &str) -> Command {
    let (name, flag) = if cfg!(windows) { ("cmd", "/C") } else { ("sh", "-c") };
    let mut shell = Command::new(name);
    shell.args([flag, command]).stdin(Stdio::null()).stdout(Stdio::piped());
    shell
}

/// Reads output on a second thread, which blocks in the read, while this thread waits and kills the program.
fn read_program(mut child: Child, teller: &Teller) {
    let Some(output) = child.stdout.take() else { return teller.end("it has no output") };
    let of_thread = teller.clone();
    let run = move || read_lines(output, &of_thread);
    let Ok(reading) = thread::Builder::new().name("program".to_owned()).spawn(run) else {
        return teller.end("there is no thread for it");
    };
    while teller.goes_on() && !reading.is_finished() {
        thread::sleep(WAIT);
    }
    let _ = child.kill();
    let status = child.wait();
    // Children of a killed program may hold its output open: do not join a thread that reads.
    let read = if reading.is_finished() { reading.join() } else { Ok(Ok(())) };
    match (read, status) {
        (Ok(Err(problem)), _) => teller.end(problem),
        (_, Ok(status)) if !status.success() => {
            teller.end(format!("the program ended ({status})"));
        }
        _ => teller.end("the program ended"),
    }
}

fn read_lines(mut input: impl Read, teller: &Teller) -> Result<(), String> {
    let mut reader = LineReader::default();
    let mut waiting = Vec::new();
    let mut buffer = vec![0; 1 << 16];
    let mut order = LineOrder::default();
    while teller.goes_on() {
        let count = match input.read(&mut buffer) {
            Ok(0) => return Ok(()),
            Ok(count) => count,
            Err(error) if is_pause(&error) => continue,
            Err(error) => return Err(error.to_string()),
        };
        let arrival = Instant::now();
        waiting.extend_from_slice(&buffer[..count]);
        let Some(end) = waiting.iter().rposition(|byte| *byte == b'\n') else {
            if waiting.len() > LONGEST {
                return Err("its lines do not end".to_owned());
            }
            continue;
        };
        let whole: Vec<u8> = waiting.drain(..=end).collect();
        let lines = String::from_utf8_lossy(&whole);
        let mut samples = Vec::new();
        for line in lines.lines() {
            match reader.read(line) {
                Ok(Some(sample)) => samples.push(sample),
                Ok(None) if reader.axes().is_empty() || line.trim().is_empty() => {}
                Ok(None) if order.number == 0 && samples.is_empty() => {}
                Ok(None) => lock(&teller.state).counts.damaged += 1,
                Err(bad) => return Err(bad.to_string()),
            }
        }
        *lock(&teller.axes) = reader.axes();
        let last = samples.len();
        for (at, sample) in samples.into_iter().enumerate() {
            let tick = sample.time_s.or(sample.number.map(|number| number as f64));
            if tick.is_none() && at + 1 < last {
                lock(&teller.state).counts.untimed += 1;
                continue;
            }
            if let Some((number, restarted)) = order.place(sample.number, tick) {
                let wrench = Some(sample.wrench);
                let missing = order.missing;
                let (status, tick) = (0, tick);
                teller.tell(ReferenceSample {
                    number,
                    tick,
                    restarted,
                    arrival,
                    wrench,
                    status,
                    missing,
                });
            } else {
                lock(&teller.state).counts.duplicates += 1;
            }
        }
        thread::sleep(PACE);
    }
    Ok(())
}

#[derive(Clone, Copy, Debug, Default)]
struct LineOrder {
    number: i64,
    last: Option<(Option<i64>, Option<f64>)>,
    missing: u64,
}

impl LineOrder {
    /// Returns a sample's number, and true after a restart; `None` if it repeats the previous one.
    fn place(&mut self, own: Option<i64>, tick: Option<f64>) -> Option<(i64, bool)> {
        let last = self.last.replace((own, tick));
        let step = match (last.and_then(|(own, _)| own), own) {
            (Some(last), Some(own)) => own.saturating_sub(last),
            _ => 1,
        };
        let ticks = last.and_then(|(_, tick)| tick).zip(tick);
        let is_back = step < 0 || ticks.is_some_and(|(last, tick)| tick < last);
        let is_same = step == 0 || own.is_none() && ticks.is_some_and(|(last, tick)| tick == last);
        if is_same && !is_back {
            return None;
        }
        let step = if is_back { 1 } else { step };
        self.missing += step.unsigned_abs() - 1;
        self.number = self.number.saturating_add(step);
        Some((self.number, is_back))
    }
}
