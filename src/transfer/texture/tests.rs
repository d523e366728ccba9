use super::super::Lattice;
use super::*;
use crate::grid3;

fn layout() -> Layout {
    Layout {
        lattice: Lattice::from_texels([9, 20, 17], [9, 20, 17]).unwrap(),
        layers: Layers::new(vec![2, 1]).unwrap(),
    }
}

#[test]
fn a_brick_comes_back_from_its_own_index_only() {
    let mut texture = MemoryTexture::new(layout());
    let mut brick = Brick::unbaked(&layout().layers);
    brick.rays[3] = 7;
    assert!(texture.insert([1, 2, 0], brick.clone()).unwrap().is_none());
    let [nx, ny, nz] = layout().lattice.bricks();
    assert_eq!([nx, ny, nz], [2, 3, 3]);
    for index in grid3::all([nx, ny, nz]) {
        assert_eq!(texture.brick(index).unwrap().is_some(), index == [1, 2, 0]);
    }
    assert_eq!(texture.brick([1, 2, 0]).unwrap().unwrap().rays, &brick.rays[..]);
    let copy = MemoryTexture::from_source(&texture).unwrap();
    assert_eq!((copy.len(), copy.brick([1, 2, 0]).unwrap().unwrap().rays[3]), (1, 7));
    assert!(texture.remove([1, 2, 0]).unwrap().is_some() && texture.is_empty());
}

#[test]
fn a_chunk_goes_in_brick_by_brick() {
    let lattice = Lattice::from_texels([40; 3], [40; 3]).unwrap();
    let mut texture = MemoryTexture::new(Layout { lattice, ..layout() });
    let mut bricks = vec![None; 64];
    // The second of the second row of the second layer.
    bricks[1 + 4 + 16] = Some(Brick::unbaked(&layout().layers));
    texture.insert_chunk([0; 3], bricks.clone()).unwrap();
    assert!(texture.len() == 1 && texture.brick([1; 3]).unwrap().is_some());
    // Of the next chunk only one brick lies in the lattice.
    assert!(texture.insert_chunk([1, 0, 0], bricks).is_err());
}

#[test]
fn indices_and_bricks_that_do_not_fit_are_refused_by_name() {
    let mut texture = MemoryTexture::new(layout());
    assert!(texture.brick([2, 0, 0]).unwrap_err().to_string().contains("(2, 0, 0)"));
    let other = Brick::unbaked(&Layers::uniform(2, 2).unwrap());
    let message = texture.insert([0; 3], other).unwrap_err().to_string();
    assert!(message.contains("brick.transfer") && message.contains("2560"), "{message}"); // 512·(4+1)
}
