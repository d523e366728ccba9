//! A bake in three shares, each into a store of its own as three machines would, put together.
//!
//! cargo run --release --example shares -- FOLDER

use isolume::{Bake, Scene, Silent, Store, StoreOptions};
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).ok_or("name a folder")?);
    let scene = Scene::open("bumpbox:80")?;
    let mut shares: Vec<Store> = Vec::new();
    for share in 1..=3 {
        let bake = Bake::of(&scene).isovalues([47.0]).rays(16).share(share, 3)?;
        shares.push(bake.run(folder.join(format!("{share}.isolume")), &Silent)?.0);
    }
    let (whole, brought) = StoreOptions::default().merge(&shares, folder.join("whole.isolume"))?;
    println!("{} chunks from {brought:?}", whole.holdings()?.chunks);
    Ok(())
}
