//! Files between this library and other programs: theirs read here (`formats_python`), ours read there (`store_python`,
//! `gltf_validator`). Without the other program a test skips and says so.

mod formats_python;
mod gltf_validator;
mod store_python;
