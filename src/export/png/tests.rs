use super::*;

fn decode(bytes: &[u8]) -> (::png::Info<'static>, Vec<u8>) {
    let mut reader = ::png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    let mut info = reader.info().clone();
    reader.finish().unwrap();
    info.utf8_text.clone_from(&reader.info().utf8_text);
    (info, pixels)
}

#[test]
fn a_decoder_reads_back_srgb_codes_and_the_chunk() {
    let pixels = vec![[0.0, 0.2140, 1.0, 0.0], [2.0, -1.0, 0.5, 0.5], [0.0031308, 0.1, 0.9, 1.0]];
    let image = Image::new(3, 1, pixels).unwrap();
    let expected: [[u8; 4]; 3] = std::array::from_fn(|i| image.pixels()[i]).map(|[r, g, b, a]: [f32; 4]| {
        let code = |v: f32| (255.0 * srgb::srgb_from_linear(f64::from(v))).round() as u8;
        [code(r), code(g), code(b), (a * 255.0).round() as u8]
    });
    assert_eq!(expected[0][1], 127); // 0.2140 is 127.49 of 255
    for alpha in [false, true] {
        let options = PngOptions { alpha, software: Some("isolume".into()), description: Some("ρ = 0.7".into()) };
        let mut bytes = Vec::new();
        write(&mut bytes, &image, &options).unwrap();
        let (info, decoded) = decode(&bytes);
        assert_eq!(info.srgb, Some(::png::SrgbRenderingIntent::RelativeColorimetric));
        assert_eq!(info.utf8_text[1].get_text().unwrap(), "ρ = 0.7");
        let kept = if alpha { 4 } else { 3 };
        assert_eq!(decoded, expected.iter().flat_map(|p| p[..kept].to_vec()).collect::<Vec<_>>());
    }
}

#[test]
fn a_pixel_that_is_not_finite_is_named() {
    let mut image = Image::filled(4, 3, [0.5; 4]).unwrap();
    image.pixels_mut()[6][1] = f32::NAN;
    let message = write(&mut Vec::new(), &image, &PngOptions::default()).unwrap_err().to_string();
    assert!(message.contains("column 2, row 1"), "{message}");
}
