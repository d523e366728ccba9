//! Formulas: `sin(x)*cos(y) + 2*r^2` becomes a program for a stack. Functions are those of the crate `libm`: the same bits
//! on every machine.
//!
//! Parsers exist (exmex), and none gives the derivative, the range in a box and the place of an error in one pass over
//! numbers that are ours; this one is a page.

use super::interval::Interval;
use super::sample::Points;
use super::scalar::{Point, Scalar};
use super::warp::Region;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Longest formula in bytes.
pub const LONGEST: usize = 1 << 14;
/// Deepest nesting of parentheses.
const DEEPEST: usize = 64;
/// Most numbers on the stack.
const STACK: usize = 64;
/// Largest power that is multiplied out.
const MOST_POWER: i32 = 64;

/// What is wrong with a formula, and at which byte.
#[derive(Clone, Debug, PartialEq)]
pub struct Wrong {
    /// The byte.
    pub at: usize,
    /// What was found.
    pub found: String,
    /// What could stand there.
    pub expected: String,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Code {
    Number(f64),
    Coordinate(u8),
    Add,
    Subtract,
    Multiply,
    Divide,
    Negate,
    Power,
    /// A whole number as exponent.
    Whole(i32),
    Call(Function),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Function {
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Atan2,
    Exp,
    Ln,
    Log2,
    Sqrt,
    Cbrt,
    Abs,
    Min,
    Max,
    Floor,
    Clamp,
}

const FUNCTIONS: [(&str, Function, usize); 17] = [
    ("sin", Function::Sin, 1),
    ("cos", Function::Cos, 1),
    ("tan", Function::Tan, 1),
    ("asin", Function::Asin, 1),
    ("acos", Function::Acos, 1),
    ("atan", Function::Atan, 1),
    ("atan2", Function::Atan2, 2),
    ("exp", Function::Exp, 1),
    ("ln", Function::Ln, 1),
    ("log2", Function::Log2, 1),
    ("sqrt", Function::Sqrt, 1),
    ("cbrt", Function::Cbrt, 1),
    ("abs", Function::Abs, 1),
    ("min", Function::Min, 2),
    ("max", Function::Max, 2),
    ("floor", Function::Floor, 1),
    ("clamp", Function::Clamp, 3),
];

/// A formula in x, y, z.
#[derive(Clone, Debug, PartialEq)]
pub struct Formula {
    // Invariant: leaves one number on a stack of at most STACK.
    program: Vec<Code>,
}

struct Parser<'a> {
    text: &'a str,
    at: usize,
    depth: usize,
    parameters: &'a [(String, f64)],
    program: Vec<Code>,
}

impl Formula {
    /// Reads a formula; parameters have names and values.
    ///
    /// # Errors
    /// What does not belong there, and at which byte.
    pub fn parse(text: &str, parameters: &[(String, f64)]) -> Result<Self, Wrong> {
        let refuse =
            |at: usize, found: &str, expected: &str| Wrong { at, found: found.into(), expected: expected.into() };
        if text.len() > LONGEST {
            return Err(refuse(0, &format!("{} bytes", text.len()), &format!("a formula of at most {LONGEST} bytes")));
        }
        let mut parser = Parser { text, at: 0, depth: 0, parameters, program: Vec::new() };
        parser.sum()?;
        parser.skip();
        if parser.at < text.len() {
            return Err(parser.wrong("an operator or the end"));
        }
        let formula = Self { program: parser.program };
        if formula.depth() > STACK {
            return Err(refuse(0, "a formula that keeps too many numbers", "parts of it as formulas of their own"));
        }
        Ok(formula)
    }

    fn depth(&self) -> usize {
        let (mut now, mut most) = (0usize, 0);
        for code in &self.program {
            now += 1;
            now -= code.takes();
            most = most.max(now);
        }
        most
    }

    /// The value at a point; NaN where it has none.
    pub fn value<S: Scalar>(&self, p: Point<S>) -> S {
        let mut stack = [S::of(0.0); STACK];
        let mut top = 0;
        for code in &self.program {
            let takes = code.takes();
            let first = top - takes;
            stack[first] = match code {
                Code::Number(v) => S::of(*v),
                Code::Coordinate(axis) => p[*axis as usize],
                Code::Add => stack[first] + stack[first + 1],
                Code::Subtract => stack[first] - stack[first + 1],
                Code::Multiply => stack[first] * stack[first + 1],
                Code::Divide => stack[first] / stack[first + 1],
                Code::Negate => -stack[first],
                Code::Power => power(stack[first], stack[first + 1]),
                Code::Whole(n) => whole(stack[first], *n),
                Code::Call(function) => call(*function, &stack[first..top]),
            };
            top = first + 1;
        }
        stack[0]
    }

    /// The values at many points.
    pub fn fill(&self, points: &Points, out: &mut [f64]) {
        points.map(out, |p| self.value(p));
    }

    /// Where the values in a box lie; all numbers where one may be missing.
    pub fn bounds(&self, region: &Region) -> Interval {
        let mut stack: Vec<Interval> = Vec::with_capacity(8);
        for code in &self.program {
            let rest = stack.split_off(stack.len() - code.takes());
            let range = match code {
                Code::Number(v) => Some(Interval::at(*v)),
                Code::Coordinate(axis) => {
                    let (c, h) = (region.centre[*axis as usize], region.half[*axis as usize]);
                    Some(Interval::new(c - h, c + h).widened())
                }
                Code::Add => Some((rest[0] + rest[1]).widened().around(rounding(&rest))),
                Code::Subtract => Some((rest[0] - rest[1]).widened().around(rounding(&rest))),
                Code::Multiply => Some((rest[0] * rest[1]).widened()),
                Code::Divide => quotient(rest[0], rest[1]),
                Code::Negate => Some(-rest[0]),
                Code::Power => range_of_power(rest[0], rest[1]),
                Code::Whole(n) => range_of_whole(rest[0], *n),
                Code::Call(function) => range_of_call(*function, &rest),
            };
            match range {
                Some(range) if range.low.is_finite() && range.high.is_finite() => stack.push(range),
                // What is not known here may be NaN: nothing that is made of it is known.
                _ => return Interval::ALL,
            }
        }
        let range = stack.pop().unwrap_or(Interval::ALL);
        // One number to the bit is what the sampler would fill a box with: only a formula without coordinates is one.
        if range.low == range.high { range.around(1e-300) } else { range }
    }
}

fn rounding(of: &[Interval]) -> f64 {
    1e-14 * of.iter().map(|i| i.low.abs().max(i.high.abs())).fold(0.0, f64::max)
}

impl Code {
    fn takes(&self) -> usize {
        match self {
            Self::Number(_) | Self::Coordinate(_) => 0,
            Self::Negate | Self::Whole(_) => 1,
            Self::Add | Self::Subtract | Self::Multiply | Self::Divide | Self::Power => 2,
            Self::Call(function) => FUNCTIONS.iter().find(|f| f.1 == *function).map_or(1, |f| f.2),
        }
    }
}

impl Parser<'_> {
    fn skip(&mut self) {
        let rest = &self.text[self.at..];
        self.at += rest.len() - rest.trim_start().len();
    }

    fn next(&mut self) -> Option<char> {
        self.skip();
        self.text[self.at..].chars().next()
    }

    fn take(&mut self, wanted: char) -> bool {
        let is_there = self.next() == Some(wanted);
        if is_there {
            self.at += wanted.len_utf8();
        }
        is_there
    }

    fn wrong(&mut self, expected: &str) -> Wrong {
        let found = match self.next() {
            Some(c) => format!("`{c}` at character {}", self.text[..self.at].chars().count() + 1),
            None => "the end of the formula".into(),
        };
        Wrong { at: self.at, found, expected: expected.into() }
    }

    fn sum(&mut self) -> Result<(), Wrong> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(self.wrong("fewer parentheses inside each other"));
        }
        self.product()?;
        loop {
            let code = if self.take('+') {
                Code::Add
            } else if self.take('-') {
                Code::Subtract
            } else {
                self.depth -= 1;
                return Ok(());
            };
            self.product()?;
            self.program.push(code);
        }
    }

    fn product(&mut self) -> Result<(), Wrong> {
        self.signed()?;
        loop {
            let code = if self.take('*') {
                Code::Multiply
            } else if self.take('/') {
                Code::Divide
            } else {
                return Ok(());
            };
            self.signed()?;
            self.program.push(code);
        }
    }

    /// −x² is −(x²).
    fn signed(&mut self) -> Result<(), Wrong> {
        let mut negative = false;
        loop {
            if self.take('-') {
                negative = !negative;
            } else if !self.take('+') {
                break;
            }
        }
        self.atom()?;
        if self.take('^') {
            let before = self.program.len();
            self.depth += 1;
            if self.depth > DEEPEST {
                return Err(self.wrong("fewer powers of powers"));
            }
            self.signed()?;
            self.depth -= 1;
            let exponent = match self.program[before..] {
                [Code::Number(n)] => Some(n),
                [Code::Number(n), Code::Negate] => Some(-n),
                _ => None,
            };
            match exponent.filter(|n| n.fract() == 0.0 && n.abs() <= f64::from(MOST_POWER)) {
                Some(n) => {
                    self.program.truncate(before);
                    self.program.push(Code::Whole(n as i32));
                }
                None => self.program.push(Code::Power),
            }
        }
        if negative {
            self.program.push(Code::Negate);
        }
        Ok(())
    }

    fn atom(&mut self) -> Result<(), Wrong> {
        let Some(first) = self.next() else { return Err(self.wrong("a number, a name or `(`")) };
        if self.take('(') {
            self.sum()?;
            return if self.take(')') { Ok(()) } else { Err(self.wrong("`)` or an operator")) };
        }
        if first.is_ascii_digit() || first == '.' {
            return self.number();
        }
        if !(first.is_ascii_alphabetic() || first == '_') {
            return Err(self.wrong("a number, a name or `(`"));
        }
        let start = self.at;
        let rest = &self.text[start..];
        let length = rest.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(rest.len());
        let word = &rest[..length];
        self.at += length;
        if let Some((_, value)) = self.parameters.iter().find(|(name, _)| name == word) {
            self.program.push(Code::Number(*value));
            return Ok(());
        }
        let code = match word {
            "x" => Some(Code::Coordinate(0)),
            "y" => Some(Code::Coordinate(1)),
            "z" => Some(Code::Coordinate(2)),
            "pi" => Some(Code::Number(PI)),
            _ => None,
        };
        if let Some(code) = code {
            self.program.push(code);
            return Ok(());
        }
        let Some((_, function, arguments)) = FUNCTIONS.iter().find(|f| f.0 == word) else {
            let names: Vec<&str> = self.parameters.iter().map(|p| p.0.as_str()).collect();
            let functions = FUNCTIONS.map(|f| f.0).join(" ");
            let expected =
                format!("x y z pi {}{}{functions}", names.join(" "), if names.is_empty() { "" } else { " " });
            return Err(Wrong { at: start, found: format!("the name `{word}`"), expected });
        };
        if !self.take('(') {
            return Err(self.wrong(&format!("`(` after {word}")));
        }
        for i in 0..*arguments {
            if i > 0 && !self.take(',') {
                return Err(self.wrong(&format!("`,`: {word} takes {arguments} values")));
            }
            self.sum()?;
        }
        if !self.take(')') {
            return Err(self.wrong(&format!("`)`: {word} takes {arguments}")));
        }
        self.program.push(Code::Call(*function));
        Ok(())
    }

    fn number(&mut self) -> Result<(), Wrong> {
        let bytes = self.text.as_bytes();
        let start = self.at;
        let mut end = start;
        while end < bytes.len() && (bytes[end].is_ascii_digit() || bytes[end] == b'.') {
            end += 1;
        }
        if end < bytes.len() && (bytes[end] | 0x20) == b'e' {
            let mut after = end + 1;
            if after < bytes.len() && (bytes[after] == b'+' || bytes[after] == b'-') {
                after += 1;
            }
            if after < bytes.len() && bytes[after].is_ascii_digit() {
                while after < bytes.len() && bytes[after].is_ascii_digit() {
                    after += 1;
                }
                end = after;
            }
        }
        let value = self.text[start..end].parse().ok().filter(|v: &f64| v.is_finite());
        let value = value.ok_or_else(|| self.wrong("a number such as 0.5 or 1e-3"))?;
        self.at = end;
        self.program.push(Code::Number(value));
        Ok(())
    }
}

fn whole<S: Scalar>(x: S, n: i32) -> S {
    let mut result: Option<S> = None;
    let (mut square, mut left) = (x, n.unsigned_abs());
    while left > 0 {
        if left & 1 == 1 {
            result = Some(result.map_or(square, |r| r * square));
        }
        square = square * square;
        left >>= 1;
    }
    let result = result.unwrap_or(S::of(1.0));
    if n < 0 { S::of(1.0) / result } else { result }
}

/// a^b for a ≥ 0; NaN for negative a. Whole exponents that are written as numbers take [`whole`].
fn power<S: Scalar>(a: S, b: S) -> S {
    if a.value() > 0.0 {
        (b * a.logarithm()).exponential()
    } else if a.value() == 0.0 && b.value() > 0.0 {
        S::of(0.0)
    } else {
        S::of(f64::NAN)
    }
}

fn call<S: Scalar>(function: Function, of: &[S]) -> S {
    let a = of[0];
    let x = a.value();
    match function {
        Function::Sin => a.sine(),
        Function::Cos => a.cosine(),
        Function::Tan => a.sine() / a.cosine(),
        Function::Asin => a.chain(libm::asin(x), || {
            let slope = 1.0 / (1.0 - x * x).sqrt();
            [slope, x * slope * slope * slope]
        }),
        Function::Acos => a.chain(libm::acos(x), || {
            let slope = 1.0 / (1.0 - x * x).sqrt();
            [-slope, -x * slope * slope * slope]
        }),
        Function::Atan => a.arc_tangent(),
        Function::Atan2 => a.angle(of[1]),
        Function::Exp => a.exponential(),
        Function::Ln => a.logarithm(),
        Function::Log2 => a.logarithm().scaled(std::f64::consts::LOG2_E),
        Function::Sqrt => a.root(),
        Function::Cbrt => {
            let root = libm::cbrt(x);
            a.chain(root, || {
                let square = root * root;
                if root == 0.0 { [0.0; 2] } else { [1.0 / (3.0 * square), -2.0 / (9.0 * square * square * root)] }
            })
        }
        Function::Abs => a.magnitude(),
        Function::Min => a.smaller(of[1]),
        Function::Max => a.larger(of[1]),
        Function::Floor => S::of(x.floor()),
        Function::Clamp => a.larger(of[1]).smaller(of[2]),
    }
}

fn quotient(a: Interval, b: Interval) -> Option<Interval> {
    if b.low <= 0.0 && b.high >= 0.0 {
        return None;
    }
    Some((a * Interval::new(1.0 / b.high, 1.0 / b.low)).widened())
}

fn range_of_whole(a: Interval, n: i32) -> Option<Interval> {
    let ends = [whole(a.low, n.abs()), whole(a.high, n.abs())];
    let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
    let spans = a.low <= 0.0 && a.high >= 0.0;
    let power = Interval::new(if n % 2 == 0 && spans { 0.0 } else { low }, high).widened();
    if n == 0 {
        Some(Interval::at(1.0))
    } else if n < 0 {
        quotient(Interval::at(1.0), power)
    } else {
        Some(power)
    }
}

fn range_of_power(a: Interval, b: Interval) -> Option<Interval> {
    if a.low <= 0.0 {
        return None;
    }
    let logarithm = Interval::new(libm::log(a.low), libm::log(a.high)).around(1e-12);
    let exponent = b * logarithm;
    Some(Interval::new(libm::exp(exponent.low), libm::exp(exponent.high)).widened())
}

fn range_of_call(function: Function, of: &[Interval]) -> Option<Interval> {
    let a = of[0];
    let rising = |f: fn(f64) -> f64| Interval::new(f(a.low), f(a.high)).widened().around(1e-15);
    Some(match function {
        Function::Sin => range_of_sine(a),
        Function::Cos => range_of_sine(a + FRAC_PI_2),
        Function::Tan => return quotient(range_of_sine(a), range_of_sine(a + FRAC_PI_2)),
        Function::Asin if a.low >= -1.0 && a.high <= 1.0 => rising(libm::asin),
        Function::Acos if a.low >= -1.0 && a.high <= 1.0 => {
            Interval::new(libm::acos(a.high), libm::acos(a.low)).widened().around(1e-15)
        }
        Function::Asin | Function::Acos => return None,
        Function::Atan => rising(libm::atan),
        Function::Atan2 => Interval::new(-PI, PI).widened(),
        Function::Exp => rising(libm::exp),
        Function::Ln | Function::Log2 | Function::Sqrt if a.low < 0.0 || a.low == 0.0 && function != Function::Sqrt => {
            return None;
        }
        Function::Ln => rising(libm::log),
        Function::Log2 => rising(|x| libm::log(x) * std::f64::consts::LOG2_E),
        Function::Sqrt => rising(f64::sqrt),
        Function::Cbrt => rising(libm::cbrt),
        Function::Abs => a.magnitude(),
        Function::Min => a.smaller(of[1]),
        Function::Max => a.larger(of[1]),
        Function::Floor => Interval::new(a.low.floor(), a.high.floor()),
        Function::Clamp => a.larger(of[1]).smaller(of[2]),
    })
}

/// Sines over a range of angles.
fn range_of_sine(a: Interval) -> Interval {
    let whole = Interval::new(-1.0, 1.0).widened();
    if a.high - a.low >= TAU || a.low.abs() > 1e8 || a.high.abs() > 1e8 {
        return whole;
    }
    // Whether an angle at + 2πk lies in the range, with a margin.
    let holds = |at: f64| {
        let k = ((a.low - at - 1e-7) / TAU).ceil();
        at + k * TAU <= a.high + 1e-7
    };
    let (first, last) = (libm::sin(a.low), libm::sin(a.high));
    let low = if holds(-FRAC_PI_2) { -1.0 } else { first.min(last) };
    let high = if holds(FRAC_PI_2) { 1.0 } else { first.max(last) };
    Interval::new(low, high).around(1e-7 * 1e-7 + 1e-12)
}
