//! Fig. 4.5 and 4.6 by themselves, and what is promised of them.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use figures::learning::{BLOCKS, GOAL_DEG, learn};

#[test]
fn both_laws_learn_on_the_traced_line_and_the_model_based_one_in_a_tenth_of_the_blocks() {
    let learning = learn(|| ()).unwrap();
    let published = &learning.published[1];
    let first = published.first_deg().unwrap();
    assert!((8.0..=14.0).contains(&first), "{first}");
    assert!(published.last_deg().unwrap() <= GOAL_DEG && published.errors_deg.len() == BLOCKS);
    let blocks = learning.model_based[1].blocks_to_goal().expect("the model-based law comes to 1°");
    assert!(blocks <= 8.0, "{blocks}");
    for case in &learning.cases {
        println!(
            "{:20} {:6.2} {:6.2} {:?} {:?}",
            case.id,
            case.published.first_deg().unwrap(),
            case.published.last_deg().unwrap(),
            case.published.blocks_to_goal(),
            case.model_based.as_ref().map(figures::learning::Course::blocks_to_goal)
        );
        assert!(
            case.published.last_deg().unwrap() < 0.5 * case.published.first_deg().unwrap(),
            "{}",
            case.id
        );
    }
    // With the printed line both laws come to 1° as well, sooner than with the softer one.
    let sooner = |courses: &[figures::learning::Course; 2]| {
        courses[0].blocks_to_goal() < courses[1].blocks_to_goal()
    };
    assert!(sooner(&learning.published) && sooner(&learning.model_based));
    assert!(
        learning.published[0].blocks_to_goal().is_some()
            && learning.model_based[0].blocks_to_goal().is_some()
    );
    let table = learning.csv();
    assert_eq!(table.lines().count(), 1 + BLOCKS);
    assert!(table.lines().all(|line| line.split(',').count() == 5));
}
