//! JSON with a few values replaced, wrapped up again as a reader expects it.

use super::mutate::Numbers;
use super::seeds;
use serde_json::Value;

/// A document of a store with a few values replaced, and its seal made right again: what somebody who knows
/// the format could write.
pub fn resealed(numbers: &mut Numbers, bytes: &[u8]) -> Vec<u8> {
    let Ok(mut value) = serde_json::from_slice::<Value>(bytes) else { return bytes.to_vec() };
    for _ in 0..1 + numbers.below(3) {
        replace_leaf(numbers, &mut value);
    }
    let hash = |value: &Value| {
        let mut sorted = value.clone();
        sorted.sort_all_objects();
        blake3::hash(sorted.to_string().as_bytes()).to_hex().to_string()
    };
    if let Some(attributes) = value.get_mut("attributes").filter(|a| a.is_object()) {
        if let Some(fields) = attributes.as_object_mut() {
            fields.shift_remove("blake3");
        }
        attributes["blake3"] = hash(attributes).into();
    } else if value.get("stamp").is_some() {
        if let Some(fields) = value.as_object_mut() {
            fields.shift_remove("stamp");
        }
        value["stamp"] = hash(&value)[..32].into();
    }
    value.to_string().into_bytes()
}

/// A glTF or GLB with a few values of its JSON replaced; `None` for other meshes.
pub fn other_values(numbers: &mut Numbers, bytes: &[u8]) -> Option<Vec<u8>> {
    let length = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?) as usize);
    let is_binary = bytes.starts_with(b"glTF");
    let (json, rest) = if is_binary { bytes.get(20..)?.split_at_checked(length(12)?)? } else { (bytes, &[][..]) };
    let mut value: Value = serde_json::from_slice(json).ok()?;
    for _ in 0..1 + numbers.below(3) {
        replace_leaf(numbers, &mut value);
    }
    let json = value.to_string().into_bytes();
    Some(if is_binary { seeds::glb(&json, rest) } else { json })
}

fn replace_leaf(numbers: &mut Numbers, value: &mut Value) {
    let mut leaves = 0;
    visit(value, &mut |_| leaves += 1);
    let chosen = numbers.below(leaves);
    let new = replacement(numbers);
    let mut at = 0;
    visit(value, &mut |leaf| {
        if at == chosen {
            *leaf = new.clone();
        }
        at += 1;
    });
}

fn visit(value: &mut Value, each: &mut impl FnMut(&mut Value)) {
    match value {
        Value::Array(list) => list.iter_mut().for_each(|v| visit(v, each)),
        Value::Object(fields) => fields.values_mut().for_each(|v| visit(v, each)),
        leaf => each(leaf),
    }
}

fn replacement(numbers: &mut Numbers) -> Value {
    match numbers.below(14) {
        0 => Value::Null,
        1 => 0.into(),
        2 => 1.into(),
        3 => (-1).into(),
        4 => u64::MAX.into(),
        5 => (1u64 << 24).into(),
        6 => (1u64 << 32).into(),
        7 => serde_json::json!(1e308),
        8 => serde_json::json!(-1e-320),
        9 => "".into(),
        10 => "../../x".into(),
        11 => Value::Array(vec![]),
        12 => true.into(),
        _ => numbers.below(40).into(),
    }
}
