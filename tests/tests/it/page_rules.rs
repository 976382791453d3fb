//! Rules for every page, checked in a headless browser.

use std::fs;
use std::path::Path;

use serde_json::Value;
use system_tests::browser::Browser;

/// `cargo xtask test` fetches axe-core if possible.
const AXE: &str = "SHELLCAL_AXE";

pub fn keep(base64: &str, name: &str) {
    // For inspection: `SHELLCAL_SCREENSHOTS` keeps the screens.
    if let Some(folder) = std::env::var_os("SHELLCAL_SCREENSHOTS") {
        fs::write(Path::new(&folder).join(name), base64).unwrap();
    }
}

/// Returns the lowest contrast of text; WCAG 2.2 AA requires more than 4.5 to 1.
pub fn contrast(browser: &mut Browser) -> f64 {
    let contrast = "(() => { const luminance = (c) => c.match(/[\\d.]+/g).slice(0, 3).map((v) => v / 255)\
        .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))\
        .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);\
        const paper = luminance(getComputedStyle(document.body).backgroundColor);\
        return Math.min(...[...document.querySelectorAll('main p, main li, main a, main td, main th, figcaption, caption, summary, button:not([aria-pressed=true]), .quiet, strong')]\
        .map((e) => luminance(getComputedStyle(e).color)).map((ink) => (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05))); })()";
    browser.evaluate(contrast).as_f64().unwrap()
}

/// Returns violations for users without sight or mouse, with the findings of axe-core if available.
pub fn check_rules(browser: &mut Browser) {
    let faults = "(() => { const all = (s) => [...document.querySelectorAll(s)], faults = [];\
        if (!document.documentElement.lang) faults.push('no language');\
        if (!document.title) faults.push('no title');\
        for (const one of ['h1', 'main', 'header']) if (all(one).length !== 1) faults.push(`${all(one).length} of ${one}`);\
        let last = 0; for (const h of all('h1, h2, h3, h4')) { const level = Number(h.tagName[1]); if (level > last + 1) faults.push(`heading ${h.textContent} skips a level`); last = level; }\
        for (const th of all('th')) if (!th.scope || !th.textContent.trim()) faults.push('a table header without scope or text');\
        for (const t of all('table')) if (!t.caption?.textContent.trim()) faults.push('a table without a caption');\
        for (const f of all('figure')) if (!f.querySelector('figcaption')?.textContent.trim()) faults.push('a figure without a caption');\
        for (const i of all('[role=img], img')) if (!(i.getAttribute('aria-label') || i.alt || '').trim()) faults.push('a picture without a description');\
        for (const s of all('main svg')) if (!s.closest('[role=img], [role=group][aria-label]')) faults.push('a drawing without a description');\
        for (const b of all('button, a, summary')) if (!(b.getAttribute('aria-label') || b.textContent || b.dataset.title || '').trim()) faults.push(`${b.tagName} without a name`);\
        for (const e of all('[tabindex]')) if (e.tabIndex > 0) faults.push('the order of the focus is not that of the page');\
        const ids = all('[id]').map((e) => e.id); if (new Set(ids).size !== ids.length) faults.push('an id stands twice');\
        for (const a of all('a[href^=\"#\"]')) if (!document.getElementById(a.hash.slice(1))) faults.push(`${a.hash} leads nowhere`);\
        return [...new Set(faults)]; })()";
    assert_eq!(browser.evaluate(faults), Value::Array(Vec::new()));
    let Some(axe) = std::env::var_os(AXE) else { return };
    let axe = fs::read_to_string(axe).unwrap();
    browser.evaluate(&format!("{axe};0"));
    let found = browser.evaluate(
        "axe.run(document).then((r) => r.violations.map((v) => `${v.id}: ${v.nodes[0].html.slice(0, 200)} ${v.nodes[0].failureSummary}`))",
    );
    assert_eq!(found, Value::Array(Vec::new()));
}

/// Checks that the page does not scroll sideways, is legible, and follows the rules.
pub fn check_page(browser: &mut Browser, width: u32) {
    let beyond = "document.documentElement.scrollWidth - document.documentElement.clientWidth";
    assert_eq!(browser.evaluate(beyond), 0, "{width}");
    assert!(contrast(browser) > 4.5, "{width}");
    check_rules(browser);
}
