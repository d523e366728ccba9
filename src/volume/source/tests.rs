use super::*;

/// A stream that hands out one byte at a time.
struct Drip<'a>(&'a [u8]);
impl Read for Drip<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let n = self.0.len().min(out.len()).min(1);
        out[..n].copy_from_slice(&self.0[..n]);
        self.0 = &self.0[n..];
        Ok(n)
    }
}

#[test]
fn peek_lines_and_tokens_do_not_depend_on_how_the_stream_is_cut() {
    let text = b"first line\r\nsecond\n1 -2.5e3\t,7\n\nlast";
    for drip in [false, true] {
        let mut s = if drip { Source::new(Drip(text), None) } else { Source::new(&text[..], Some(text.len() as u64)) };
        assert_eq!(s.peek(5).unwrap(), b"first");
        assert_eq!(s.line("t").unwrap().unwrap(), "first line");
        assert_eq!(s.peek(3).unwrap(), b"sec");
        assert_eq!(s.line("t").unwrap().unwrap(), "second");
        let mut token = Vec::new();
        let mut all = Vec::new();
        while s.token("t", &mut token).unwrap() {
            all.push(String::from_utf8(token.clone()).unwrap());
        }
        assert_eq!(all, ["1", "-2.5e3", "7", "last"]);
        assert!(s.line("t").unwrap().is_none());
        assert_eq!(s.at_most(), if drip { None } else { Some(0) });
    }
}

#[test]
fn endless_lines_tokens_and_gaps_are_refused_before_memory_is_spent() {
    assert!(Source::new(io::repeat(b'x'), None).line("t").is_err());
    assert!(Source::new(io::repeat(b'x'), None).token("t", &mut Vec::new()).is_err());
    assert!(Source::new(io::repeat(b' '), None).token("t", &mut Vec::new()).is_err());
    assert!(Source::new(&b"abc"[..], None).skip("t", 4, "padding").is_err());
    assert!(Source::new(&b"abc"[..], None).array::<4>("t", "magic").is_err());
}
