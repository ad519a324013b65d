//! Independent runs on all cores.

use crate::failure::Failure;
use crate::progress::Progress;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

/// What `work` makes of 0 to `count` − 1, in that order whatever the number of threads; of failures, the one with the lowest
/// number among those that happened.
pub(super) fn spread<T: Send>(
    what: &str,
    jobs: usize,
    count: usize,
    work: impl Fn(usize) -> Result<T, Failure> + Sync,
) -> Result<Vec<T>, Failure> {
    let progress = Progress::new(what, Some(count as u64));
    let next = AtomicUsize::new(0);
    let mut done: Vec<Option<Result<T, Failure>>> = (0..count).map(|_| None).collect();
    std::thread::scope(|scope| {
        let (send, receive) = mpsc::channel();
        for _ in 0..jobs.clamp(1, count.max(1)) {
            let (send, next, work) = (send.clone(), &next, &work);
            scope.spawn(move || {
                loop {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    if i >= count || send.send((i, work(i))).is_err() {
                        return;
                    }
                }
            });
        }
        drop(send);
        for (finished, (i, result)) in receive.into_iter().enumerate() {
            if result.is_err() {
                // Nothing new is begun; what runs is waited for.
                next.store(count, Ordering::Relaxed);
            }
            done[i] = Some(result);
            progress.at(finished as u64 + 1);
        }
    });
    done.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_do_not_depend_on_the_number_of_threads() {
        let squares = |jobs| spread("squares", jobs, 50, |i| Ok(i * i)).unwrap();
        assert_eq!(squares(1), squares(7));
        assert_eq!(squares(3)[49], 49 * 49);
        assert!(
            spread("nothing", 4, 0, Ok::<usize, Failure>)
                .unwrap()
                .is_empty()
        );
    }

    #[test]
    fn a_failure_ends_it() {
        let failed = spread("numbers", 2, 1000, |i| {
            if i == 3 {
                Err(Failure::new("odd", "three", "take another"))
            } else {
                Ok(i)
            }
        });
        assert_eq!(failed.unwrap_err().message, "three");
    }
}
