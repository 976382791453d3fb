//! Changed documents with a right checksum.

use serde_json::Value;

/// Adds a checksum of the present content, as an attacker could.
pub(crate) fn sealed(text: &str) -> String {
    let content = match text.rsplit_once(",\n  \"checksum\"") {
        Some((content, _)) => content,
        None => text.trim_end().strip_suffix("\n}").unwrap(),
    };
    let hash = twox_hash::XxHash3_128::oneshot(content.as_bytes());
    format!("{content},\n  \"checksum\": \"xxh128:{hash:032x}\"\n}}\n")
}

pub(crate) fn sealed_value(document: &Value) -> String {
    let mut document = document.clone();
    document.as_object_mut().unwrap().remove("checksum");
    sealed(&serde_json::to_string_pretty(&document).unwrap())
}
