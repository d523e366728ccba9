//! Files between this library and other programs: theirs read here (`formats_python`), ours read there (`store_python`,
//! `gltf_validator`). Without the other program a test skips and says so.

mod formats_python;
mod gltf_validator;
mod models_python;
mod packed_python;
mod page_exr;
mod store_python;

/// The interpreter that `ISOLUME_PYTHON` names, `python3` otherwise, if it runs `imports`.
fn python(imports: &str) -> Option<String> {
    let python = std::env::var("ISOLUME_PYTHON").unwrap_or_else(|_| "python3".into());
    let test = std::process::Command::new(&python).args(["-c", imports]).output();
    test.is_ok_and(|t| t.status.success()).then_some(python)
}
