//! Measurements, run by hand.

use super::*;

/// Speeds on 256³ texels of 118 bytes of transfer each (bands 5, 4, 3, 3), 2.6 GB in all:
/// `cargo test --release --lib store::tests::speed -- --ignored --nocapture`; ISOLUME_MEASURE
/// names the directory to write to.
#[test]
#[ignore = "a measurement: writes 2.6 GB"]
fn measure_writing_and_reading() {
    use std::time::Instant;
    let root = std::env::var_os("ISOLUME_MEASURE").map_or_else(std::env::temp_dir, PathBuf::from);
    let directory = tempfile::tempdir_in(root).unwrap();
    let path = directory.path().join("x.isolume");
    let dims = [256; 3];
    let volume = Volume::new(dims, Samples::U8(vec![7; 1 << 24]), Affine::IDENTITY).unwrap();
    let layers = Layers::new(vec![5, 4, 3, 3]).unwrap();
    let layout = Layout { lattice: Lattice::from_ratio(dims, 1.0).unwrap(), layers: layers.clone() };
    let identity = Identity::new(&volume, &layout, "path", false, 0);
    let report = |what: &str, megabytes: f64, start: Instant| {
        let seconds = start.elapsed().as_secs_f64();
        println!("{what}: {megabytes:.0} MB in {seconds:.2} s, {:.0} MB/s", megabytes / seconds);
    };
    let start = Instant::now();
    let store = Store::create(&path, &volume, &identity, Value::Null).unwrap();
    report("create with the volume", 16.8, start);

    let mut numbers = Numbers(1);
    let mut brick = Brick::unbaked(&layers);
    brick.transfer.iter_mut().for_each(|v| *v = f16::from_bits(numbers.next() as u16));
    let texel = (2 * layers.coefficients() + 2 * layers.errors() + 5) as f64;
    let all = (1 << 24) as f64 * texel / 1e6;
    let mut spent = std::time::Duration::ZERO;
    for index in (0..512).map(|i| [i % 8, i / 8 % 8, i / 64]) {
        let bricks = vec![Some(brick.clone()); 64];
        let start = Instant::now();
        store.write_chunk(index, bricks, &extent(64)).unwrap();
        spent += start.elapsed();
    }
    println!("write: {all:.0} MB in {:.2} s, {:.0} MB/s", spent.as_secs_f64(), all / spent.as_secs_f64());

    let start = Instant::now();
    let store = Store::open(&path).unwrap();
    println!("open: {:.2} ms", 1e3 * start.elapsed().as_secs_f64());
    let count = layout.lattice.bricks()[0];
    let pass = |what: &str, megabytes: f64, use_brick: &dyn Fn(crate::transfer::BrickView) -> u64| {
        let start = Instant::now();
        let mut sum = 0u64;
        for index in (0..count.pow(3)).map(|i| [i % count, i / count % count, i / count / count]) {
            sum = sum.wrapping_add(use_brick(store.brick(index).unwrap().unwrap()));
        }
        report(what, megabytes, start);
        assert_ne!(sum, 0);
    };
    pass("first touch of every brick, checksums verified", all, &|view| view.transfer.len() as u64);
    let transfer = all * 118.0 / texel;
    pass("sum of the transfer in place", transfer, &|view| {
        view.transfer.iter().map(|v| u64::from(v.to_bits())).sum::<u64>()
    });
    let start = Instant::now();
    for _ in 0..10 {
        for index in (0..count.pow(3)).map(|i| [i % count, i / count % count, i / count / count]) {
            assert!(store.brick(index).unwrap().is_some());
        }
    }
    println!("look-up of an open brick: {:.0} ns", 1e8 * start.elapsed().as_secs_f64() / count.pow(3) as f64);
}
