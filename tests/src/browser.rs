//! A headless Chromium, driven over its DevTools protocol; errors are panics. A shell sets up a
//! pair of pipes (`--remote-debugging-pipe`) for JSON documents, each terminated by a zero byte, to
//! descriptor 3 and from descriptor 4. That needs neither port nor library.
#![expect(clippy::unwrap_used, reason = "a test may panic and say why")]

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::program::Running;

/// Timeout of every wait, far longer than any is expected to take.
const PATIENCE: Duration = Duration::from_secs(300);

#[derive(Debug)]
pub struct Browser {
    _process: Running,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    session: String,
    next_id: u64,
    events: Vec<Value>,
    _profile: tempfile::TempDir,
}

impl Browser {
    /// Starts a browser with a page of this size in CSS pixels, as on a phone if `mobile`.
    pub fn start(chromium: &str, [width, height]: [u32; 2], mobile: bool) -> Self {
        let profile = tempfile::tempdir().unwrap();
        // A container may not allow a sandbox.
        let command = "exec \"$0\" --headless --no-sandbox --disable-gpu --disable-dev-shm-usage \
             --remote-debugging-pipe --user-data-dir=\"$1\" 3<&0 4>&1 0</dev/null 1>/dev/null";
        let mut process = Command::new("sh")
            .args(["-c", command, chromium, &profile.path().display().to_string()])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let to = process.stdin.take().unwrap();
        let from = BufReader::new(process.stdout.take().unwrap());
        let mut browser = Self {
            _process: Running(process),
            to,
            from,
            session: String::new(),
            next_id: 0,
            events: Vec::new(),
            _profile: profile,
        };
        let target = browser.call("Target.createTarget", json!({ "url": "about:blank" }));
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let session = browser.call("Target.attachToTarget", attach);
        browser.session = session["sessionId"].as_str().unwrap().to_owned();
        for domain in ["Page", "Runtime", "Log", "Network"] {
            browser.call(&format!("{domain}.enable"), json!({}));
        }
        let metrics =
            json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": mobile });
        browser.call("Emulation.setDeviceMetricsOverride", metrics);
        browser
    }

    /// Prefers a dark colour scheme from the next page on.
    pub fn prefer_dark(&mut self) {
        let features = json!([{ "name": "prefers-color-scheme", "value": "dark" }]);
        self.call("Emulation.setEmulatedMedia", json!({ "features": features }));
    }

    /// Runs a script in every page from now on, before its own.
    pub fn run_first(&mut self, script: &str) {
        self.call("Page.addScriptToEvaluateOnNewDocument", json!({ "source": script }));
    }

    pub fn open(&mut self, path: &Path) {
        self.visit(&format!("file://{}", path.canonicalize().unwrap().display()));
    }

    pub fn visit(&mut self, url: &str) {
        self.call("Page.navigate", json!({ "url": url }));
        self.wait_for("document.readyState === 'complete'");
        // A browser drops keys and clicks before the first frame of a page.
        self.wait_for_frame();
    }

    /// Evaluates an expression on the page, and awaits promises.
    pub fn evaluate(&mut self, expression: &str) -> Value {
        let wanted =
            json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        let answer = self.call("Runtime.evaluate", wanted);
        assert!(answer.get("exceptionDetails").is_none(), "{expression}: {answer}");
        answer["result"]["value"].clone()
    }

    pub fn wait_for(&mut self, expression: &str) {
        let deadline = Instant::now() + PATIENCE;
        while self.evaluate(expression) != Value::Bool(true) {
            if Instant::now() > deadline {
                let page = self.evaluate("document.body.innerText");
                panic!("`{expression}` does not become true; the page says:\n{page}");
            }
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    fn wait_for_frame(&mut self) {
        self.evaluate("new Promise((painted) => requestAnimationFrame(() => requestAnimationFrame(() => painted(0))))");
    }

    /// Clicks in the middle of the element that an expression returns, until the element receives
    /// the click: a browser looks up the target in the last frame painted, and may drop input.
    pub fn click(&mut self, element: &str) {
        let deadline = Instant::now() + PATIENCE;
        self.evaluate(&format!(
            "clicked = false; {element}.addEventListener('click', () => {{ clicked = true; }}, {{ capture: true, once: true }})"
        ));
        loop {
            self.evaluate(&format!("{element}.scrollIntoView({{ block: 'center' }})"));
            self.wait_for_frame();
            let position = self.evaluate(&format!(
                "(() => {{ const e = {element}; \
                 const r = e.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; }})()"
            ));
            for kind in ["mousePressed", "mouseReleased"] {
                let event = json!({ "type": kind, "x": position[0], "y": position[1], "button": "left", "clickCount": 1 });
                self.call("Input.dispatchMouseEvent", event);
            }
            if self.evaluate("clicked") == Value::Bool(true) {
                return;
            }
            assert!(Instant::now() < deadline, "`{element}` cannot be clicked at {position}");
        }
    }

    pub fn choose(&mut self, input: &str, files: &[PathBuf]) {
        let found = self.call("Runtime.evaluate", json!({ "expression": input }));
        let object = &found["result"]["objectId"];
        // The browser silently ignores files whose path contains `..`.
        let files: Vec<PathBuf> = files.iter().map(|file| file.canonicalize().unwrap()).collect();
        self.call("DOM.setFileInputFiles", json!({ "files": files, "objectId": object }));
    }

    pub fn save(&mut self, element: &str, name: &str) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let allow = json!({ "behavior": "allow", "downloadPath": folder.path() });
        self.call("Browser.setDownloadBehavior", allow);
        self.click(element);
        // The download has another name until it is complete.
        let (file, deadline) = (folder.path().join(name), Instant::now() + PATIENCE);
        while !file.exists() {
            assert!(Instant::now() < deadline, "`{name}` is not saved");
            std::thread::sleep(Duration::from_millis(20));
        }
        std::fs::read(file).unwrap()
    }

    /// "Tab", "Enter", " ".
    pub fn press(&mut self, key: &str) {
        let code = match key {
            "Tab" => 9,
            "Enter" => 13,
            _ => 32,
        };
        let text = if key == "Tab" {
            ""
        } else if key == "Enter" {
            "\r"
        } else {
            " "
        };
        for kind in ["keyDown", "keyUp"] {
            let text = if kind == "keyDown" { text } else { "" };
            let event =
                json!({ "type": kind, "key": key, "windowsVirtualKeyCode": code, "text": text });
            self.call("Input.dispatchKeyEvent", event);
        }
    }

    /// PNG of the whole page, in base64.
    pub fn screenshot(&mut self) -> String {
        let wanted = json!({ "captureBeyondViewport": true, "format": "png" });
        self.call("Page.captureScreenshot", wanted)["data"].as_str().unwrap().to_owned()
    }

    /// PDF, in base64.
    pub fn print(&mut self) -> String {
        let wanted = json!({ "paperWidth": 8.27, "paperHeight": 11.69 });
        self.call("Page.printToPDF", wanted)["data"].as_str().unwrap().to_owned()
    }

    /// Returns errors, warnings of the console, and exceptions so far.
    pub fn complaints(&mut self) -> Vec<String> {
        self.evaluate("0");
        let told = |event: &&Value| {
            let parameters = &event["params"];
            match event["method"].as_str() {
                Some("Runtime.exceptionThrown") => true,
                Some("Runtime.consoleAPICalled") => {
                    matches!(parameters["type"].as_str(), Some("error" | "warning" | "assert"))
                }
                Some("Log.entryAdded") => {
                    matches!(parameters["entry"]["level"].as_str(), Some("error" | "warning"))
                }
                _ => false,
            }
        };
        self.events.iter().filter(told).map(Value::to_string).collect()
    }

    /// Returns the addresses that the page has requested beyond its own file and its contents.
    pub fn requests(&mut self) -> Vec<String> {
        self.evaluate("0");
        let of = |event: &Value| {
            let is_request = event["method"] == "Network.requestWillBeSent";
            is_request.then(|| event["params"]["request"]["url"].as_str().unwrap().to_owned())
        };
        let own = |url: &String| ["file:", "data:", "blob:"].iter().any(|own| url.starts_with(own));
        self.events.iter().filter_map(of).filter(|url| !own(url)).collect()
    }

    fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.next_id += 1;
        let id = self.next_id;
        let mut request = json!({ "id": id, "method": method, "params": parameters });
        if !self.session.is_empty() {
            request["sessionId"] = Value::String(self.session.clone());
        }
        let mut bytes = request.to_string().into_bytes();
        bytes.push(0);
        self.to.write_all(&bytes).unwrap();
        loop {
            let mut message = Vec::new();
            let read = self.from.read_until(0, &mut message).unwrap();
            assert!(read > 0, "{method}: the browser has ended");
            message.pop();
            let message: Value = serde_json::from_slice(&message).unwrap();
            if message["id"] == id {
                assert!(message.get("error").is_none(), "{method}: {message}");
                return message["result"].clone();
            }
            self.events.push(message);
        }
    }
}
