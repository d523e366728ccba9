//! Small real probes inside the program (`probes/light/`, CC0), so that every command works
//! without a file.

/// Names of the embedded probes.
pub const EMBEDDED: [&str; 3] = ["courtyard", "studio", "sunset"];

/// The bytes of an embedded probe, an image file for [`super::read::read`]; `None` when no probe
/// has that name.
pub fn embedded(name: &str) -> Option<&'static [u8]> {
    match name {
        "courtyard" => Some(include_bytes!("../../probes/light/courtyard.hdr")),
        "studio" => Some(include_bytes!("../../probes/light/studio.exr")),
        "sunset" => Some(include_bytes!("../../probes/light/sunset.hdr")),
        _ => None,
    }
}
