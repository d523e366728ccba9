//! VALIDATION 28: rays that break tracers, over volumes that break them, each judged against f64. The long form
//! (10⁷ rays) and its table: `cargo run --release --example measure-stability`.

mod planted;

use crate::common::cases::ray_volumes;
use crate::common::rays::Family;
use crate::common::stability::{Tally, run};
use crate::common::twins::{Guard, Solver, TWINS};

#[test]
fn no_ray_leaks_or_hits_its_start_and_twins_with_an_epsilon_do() {
    const RAYS: u64 = 1_200;
    let (mut all, mut lit) = (Tally::default(), Tally::default());
    let mut others = vec![Tally::default(); TWINS.len()];
    for (name, volume) in ray_volumes() {
        for family in Family::ALL {
            let entry = run(&name, &volume, family, 1, RAYS, 8);
            assert_eq!(entry.all.wrong(), 0, "{name}, {}: {:?}; {:?}", family.name(), entry.all, entry.first_wrong);
            all.add(&entry.all);
            lit.add(&entry.lit);
            others.iter_mut().zip(&entry.twins).for_each(|(a, b)| a.add(b));
        }
    }
    println!("{all:?}\n{lit:?}");
    // Every kind of answer occurs, and f64 can tell nearly all of them: plateaus and far-off values are what is left.
    assert!(all.rays > 350_000 && all.hits * 10 > all.rays && all.lost * 10 > all.rays, "{all:?}");
    assert!(all.grazing * 40 < all.rays, "{all:?}");
    // The run has teeth: every twin in single precision is caught.
    for (twin, tally) in TWINS.iter().zip(&others) {
        println!("{}: {tally:?}", twin.name);
        assert_eq!(tally.rays, lit.rays);
        if twin.solver != Solver::Double {
            assert!(tally.leaks > 0 && tally.ghosts > 0, "{}: {tally:?}", twin.name);
        }
        if twin.guard == Guard::Offset(1e-3) {
            assert!(tally.leaks * 100 > tally.hits, "{}: {tally:?}", twin.name);
        }
    }
}
