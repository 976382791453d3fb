//! Documents that say something else than what was written, under a checksum that is right.

use serde_json::Value;

/// The text of a document with a checksum of its present content, as an attacker could compute it.
pub(crate) fn sealed(text: &str) -> String {
    let content = match text.rsplit_once(",\n  \"checksum\"") {
        Some((content, _)) => content,
        None => text.trim_end().strip_suffix("\n}").unwrap(),
    };
    let hash = twox_hash::XxHash3_128::oneshot(content.as_bytes());
    format!("{content},\n  \"checksum\": \"xxh128:{hash:032x}\"\n}}\n")
}

/// Like `sealed`, for a document as a value.
pub(crate) fn sealed_value(document: &Value) -> String {
    let mut document = document.clone();
    document.as_object_mut().unwrap().remove("checksum");
    sealed(&serde_json::to_string_pretty(&document).unwrap())
}
