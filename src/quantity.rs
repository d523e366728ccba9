//! Quantities as people read and write them: counts, bytes, durations, shares.

use std::time::Duration;

/// A number to about `digits` significant digits, without trailing zeros, never with more than needed.
pub fn number(value: f64, digits: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let magnitude = libm::log10(value.abs()).floor() as i32;
    if !(-5..15).contains(&magnitude) {
        return format!("{:.*e}", digits.saturating_sub(1), value);
    }
    let decimals = (digits as i32 - 1 - magnitude).clamp(0, 17) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_string() } else { text }
}

/// 12345678 → "12,345,678".
pub fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::with_capacity(digits.len() + digits.len() / 3);
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// Bytes with a decimal unit.
pub fn bytes(n: f64) -> String {
    match n {
        n if n >= 1e9 => format!("{:.2} GB", n / 1e9),
        n if n >= 1e6 => format!("{:.1} MB", n / 1e6),
        n if n >= 1e3 => format!("{:.1} kB", n / 1e3),
        n => format!("{n:.0} B"),
    }
}

/// A large number with a metric prefix, such as rays.
pub fn metric(n: f64) -> String {
    match n {
        n if n >= 1e9 => format!("{:.2} G", n / 1e9),
        n if n >= 1e6 => format!("{:.1} M", n / 1e6),
        n if n >= 1e3 => format!("{:.1} k", n / 1e3),
        n => format!("{n:.0} "),
    }
}

/// Rays in a time.
pub fn rate(rays: f64, time: Duration) -> String {
    format!("{:.2} Mrays/s", rays / time.as_secs_f64().max(1e-9) / 1e6)
}

/// A duration in milliseconds or seconds.
pub fn duration(time: Duration) -> String {
    let seconds = time.as_secs_f64();
    if seconds < 1.0 { format!("{:.1} ms", 1e3 * seconds) } else { format!("{seconds:.2} s") }
}

/// A share as a percentage; what is above 100 % only says so.
pub fn percent(share: f64) -> String {
    if share > 1.0005 { "> 100 %".into() } else { format!("{} %", number(100.0 * share, 3)) }
}

/// Reads an amount of memory, with decimal or binary units.
///
/// # Errors
/// What to write instead.
pub fn parse_bytes(text: &str) -> Result<u64, String> {
    let digits = text.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(text.len());
    let (number, unit) = text.split_at(digits);
    let factor = match unit.trim().to_ascii_lowercase().as_str() {
        "" | "b" => 1.0,
        "k" | "kb" => 1e3,
        "m" | "mb" => 1e6,
        "g" | "gb" => 1e9,
        "t" | "tb" => 1e12,
        "kib" => 1024.0,
        "mib" => 1048576.0,
        "gib" => 1073741824.0,
        _ => return Err("give a size such as 800MB, 2GB or 4GiB".into()),
    };
    match number.parse::<f64>() {
        Ok(n) if n > 0.0 => Ok((n * factor) as u64),
        _ => Err("give a size such as 800MB, 2GB or 4GiB".into()),
    }
}

/// Reads a time such as 90s, 2m, 1h30m or a number of seconds.
///
/// # Errors
/// What to write instead.
pub fn parse_time(text: &str) -> Result<Duration, String> {
    let refuse = || "give a time such as 90s, 2m or 1h30m".to_string();
    let mut seconds = 0.0;
    let mut rest = text.trim();
    while !rest.is_empty() {
        let digits = rest.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(rest.len());
        let number: f64 = rest[..digits].parse().map_err(|_| refuse())?;
        let unit: String = rest[digits..].chars().take_while(|c| c.is_ascii_alphabetic()).collect();
        seconds += number
            * match unit.as_str() {
                "" | "s" => 1.0,
                "m" | "min" => 60.0,
                "h" => 3600.0,
                _ => return Err(refuse()),
            };
        rest = &rest[digits + unit.len()..];
    }
    if seconds > 0.0 && seconds < 1e8 { Ok(Duration::from_secs_f64(seconds)) } else { Err(refuse()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_exact_enough() {
        let shown = |v: f64| number(v, 6);
        assert_eq!(
            [0.0, 90.0, 160.5, -0.6, 1e-9, 123456789.0].map(shown),
            ["0", "90", "160.5", "-0.6", "1.00000e-9", "123456789"]
        );
        assert_eq!(count(1234567), "1,234,567");
        assert_eq!(bytes(2.5e9), "2.50 GB");
    }

    #[test]
    fn times_as_people_write_them() {
        let seconds = |t: &str| parse_time(t).map(|d| d.as_secs_f64());
        assert_eq!(seconds("90s"), Ok(90.0));
        assert_eq!(seconds("2m"), Ok(120.0));
        assert_eq!(seconds("1h30m"), Ok(5400.0));
        assert_eq!(seconds("1.5"), Ok(1.5));
        for bad in ["", "0", "-3", "3 days", "1e400", "m", "5x", "ä"] {
            assert!(parse_time(bad).is_err(), "{bad}");
        }
    }
}
