//! What a navigator kept while it waited for a heading comes out in one step, unless its sink wants no more.

use insnav::config::Config;
use insnav::imu::ImuGrade;
use insnav::navigator::Navigator;
use insnav::sim::{ImuErrorModel, Scenario, Simulation};
use insnav::solution::{Epoch, Sink};

/// Counts epochs, and has enough after some.
struct Counting {
    epochs: usize,
    enough: usize,
}

impl Sink for Counting {
    fn epoch(&mut self, _epoch: &Epoch) {
        self.epochs += 1;
    }
    fn is_over(&mut self) -> bool {
        self.epochs >= self.enough
    }
}

/// A car that stands for a minute before its course tells its heading.
fn drive() -> Simulation {
    let mut scenario = Scenario::car_drive(90.0);
    scenario.imu.errors = ImuErrorModel::from_noise(ImuGrade::Automotive.noise());
    scenario.simulate(1).expect("a ready scenario")
}

/// Epochs of the step that begins the run.
fn caught_up(enough: usize) -> usize {
    let mut navigator = Navigator::new(&Config::default(), ImuGrade::Automotive.noise())
        .expect("settings in range");
    let mut sink = Counting { epochs: 0, enough };
    for sample in &drive().samples {
        navigator.step(sample, &mut sink).expect("good samples");
        if sink.epochs > 0 {
            return sink.epochs;
        }
    }
    panic!("never started");
}

#[test]
fn a_sink_that_is_over_ends_the_catching_up() {
    let whole = caught_up(usize::MAX);
    assert!(whole > 5000, "{whole} epochs in one step");
    assert_eq!(caught_up(100), 100);
}
