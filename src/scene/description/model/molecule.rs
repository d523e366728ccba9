//! Atoms of a molecule: XYZ and the ATOM and HETATM records of PDB.

use crate::error::{Error, Result};
use glam::DVec3;

/// An atom.
pub(super) struct Atom {
    /// Its symbol, such as "C" or "Cl".
    pub(super) element: String,
    /// In ångström.
    pub(super) at: DVec3,
}

/// Most atoms.
const MOST_ATOMS: usize = 50_000;

/// Radii in ångström: Bondi 1964, of H Rowland and Taylor 1996.
const RADII: [(&str, f64); 24] = [
    ("H", 1.10),
    ("He", 1.40),
    ("Li", 1.82),
    ("C", 1.70),
    ("N", 1.55),
    ("O", 1.52),
    ("F", 1.47),
    ("Ne", 1.54),
    ("Na", 2.27),
    ("Mg", 1.73),
    ("Si", 2.10),
    ("P", 1.80),
    ("S", 1.80),
    ("Cl", 1.75),
    ("Ar", 1.88),
    ("K", 2.75),
    ("Ni", 1.63),
    ("Cu", 1.40),
    ("Zn", 1.39),
    ("As", 1.85),
    ("Se", 1.90),
    ("Br", 1.85),
    ("I", 1.98),
    ("Xe", 2.16),
];

/// The van der Waals radius of an element.
pub(super) fn van_der_waals(element: &str) -> Option<f64> {
    RADII.iter().find(|(symbol, _)| symbol.eq_ignore_ascii_case(element)).map(|(_, radius)| *radius)
}

/// Reads a molecule; a first line that is a number makes it XYZ.
///
/// # Errors
/// When it is neither, or a line makes no sense.
pub(super) fn read(bytes: &[u8]) -> Result<Vec<Atom>> {
    let text = String::from_utf8_lossy(bytes);
    let is_xyz = text.lines().next().is_some_and(|line| line.trim().parse::<usize>().is_ok());
    let atoms = if is_xyz { xyz(&text)? } else { pdb(&text)? };
    if atoms.is_empty() || atoms.len() > MOST_ATOMS {
        return Err(wrong(format!("{} atoms", atoms.len()), format!("1 to {MOST_ATOMS} atoms")));
    }
    Ok(atoms)
}

fn wrong(found: String, expected: impl Into<String>) -> Error {
    Error::format("molecule", found, expected, "export it again as XYZ or PDB")
}

fn xyz(text: &str) -> Result<Vec<Atom>> {
    let count = text.lines().next().and_then(|line| line.trim().parse::<usize>().ok()).unwrap_or(0);
    if count > MOST_ATOMS {
        return Err(wrong(format!("{count} atoms"), format!("at most {MOST_ATOMS}")));
    }
    let atom = |(number, line): (usize, &str)| {
        let mut words = line.split_whitespace();
        let element = words.next().map(str::to_string);
        let mut next = || words.next().and_then(|w| w.parse::<f64>().ok()).filter(|v| v.is_finite());
        match (element, next(), next(), next()) {
            (Some(element), Some(x), Some(y), Some(z)) => Ok(Atom { element, at: DVec3::new(x, y, z) }),
            _ => Err(wrong(format!("line {}: {}", number + 1, line.trim()), "an element and x, y, z")),
        }
    };
    let atoms = text.lines().enumerate().skip(2).take(count).map(atom).collect::<Result<Vec<_>>>()?;
    if atoms.len() < count {
        return Err(wrong(format!("{} atoms", atoms.len()), format!("{count}, as the first line says")));
    }
    Ok(atoms)
}

fn pdb(text: &str) -> Result<Vec<Atom>> {
    let mut atoms = Vec::new();
    for (number, line) in text.lines().enumerate() {
        // The first of several models alone.
        if line.starts_with("ENDMDL") {
            break;
        }
        if !(line.starts_with("ATOM  ") || line.starts_with("HETATM")) {
            continue;
        }
        let columns = |from: usize, to: usize| line.get(from..to.min(line.len())).unwrap_or_default().trim();
        // Of alternate locations the first.
        if !["", "A"].contains(&columns(16, 17)) {
            continue;
        }
        let coordinate = |from: usize| columns(from, from + 8).parse::<f64>().ok().filter(|v| v.is_finite());
        let (Some(x), Some(y), Some(z)) = (coordinate(30), coordinate(38), coordinate(46)) else {
            return Err(wrong(format!("line {}: {}", number + 1, line.trim()), "x, y, z in columns 31 to 54"));
        };
        let element = match columns(76, 78) {
            // Old files: the name of the atom, whose first letter is the element of organic ones.
            "" => columns(12, 16).trim_start_matches(|c: char| c.is_ascii_digit()).chars().take(1).collect(),
            symbol => symbol.to_string(),
        };
        atoms.push(Atom { element, at: DVec3::new(x, y, z) });
        if atoms.len() > MOST_ATOMS {
            return Err(wrong(format!("more than {MOST_ATOMS} atoms"), format!("at most {MOST_ATOMS}")));
        }
    }
    if atoms.is_empty() {
        return Err(wrong("no ATOM or HETATM record, and no count of atoms in the first line".into(), "XYZ or PDB"));
    }
    Ok(atoms)
}
