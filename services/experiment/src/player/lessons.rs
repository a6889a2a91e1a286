//! The player's side of lessons: between the loop, which allocates nothing, and the teacher, who
//! does.

use std::collections::VecDeque;
use std::sync::Arc;

use ipc_types::AXES;

use super::{Player, Program};
use crate::lesson::{Lecture, Lesson, Spent};

/// What the player has for the teacher of its lessons.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant, reason = "a box would be made in the real-time loop")]
pub enum Homework {
    /// A segment begins in which something is learnt: the teacher answers with [`Lecture::Ready`]
    /// or [`Lecture::Failed`].
    Begin {
        /// Number of the lesson.
        ticket: u32,
        /// The program, and its segment.
        program: Arc<Program>,
        /// Index of the segment.
        segment: u32,
        /// Whether it goes on where it was interrupted.
        resumed: bool,
    },
    /// A record to learn from, or a reference that is no longer followed.
    Spent(Spent),
    /// The lesson is over, by itself or because somebody stopped it; with all that it still holds.
    End(Lesson),
}

/// How many pieces of homework may wait to be fetched.
pub(super) const HOMEWORK: usize = 32;

impl Player {
    /// The next thing for the teacher; to be fetched after each step until there is none.
    pub fn homework(&mut self) -> Option<Homework> {
        if let Some(lesson) = &mut self.lesson {
            while self.homework.len() < HOMEWORK - 2
                && let Some(spent) = lesson.spent()
            {
                self.homework.push_back(Homework::Spent(spent));
            }
        }
        self.homework.pop_front()
    }

    /// Takes back what the teacher could not take now.
    pub fn keep_homework(&mut self, homework: Homework) {
        self.homework.push_front(homework);
    }

    /// Takes in what the teacher says. A lesson that cannot go on stops the protocol.
    pub fn take_in(&mut self, lecture: Lecture) {
        let of_this =
            |ticket: u32| self.lesson.as_ref().is_some_and(|lesson| lesson.ticket() == ticket);
        match lecture {
            Lecture::Failed { ticket } => {
                if of_this(ticket) {
                    self.stop();
                }
            }
            lecture => match &mut self.lesson {
                Some(lesson) => lesson.take_in(lecture),
                // Of a lesson that is over.
                None => give_back(&mut self.homework, lecture),
            },
        }
    }

    /// Takes in where the slaves were (rad or m; not a number where not measured) at a scan (ns,
    /// CLOCK_MONOTONIC), and whether the motor had power. Matters to lessons only.
    pub fn record(&mut self, scan_ns: u64, slave: &[f64; AXES], powered: bool) {
        if let Some(lesson) = &mut self.lesson
            && let Some(step) =
                self.program.as_ref().and_then(|program| program.steps.get(self.segment as usize))
        {
            lesson.record(scan_ns, slave[step.axis], powered);
        }
    }

    /// The block of the lesson that is being played, from 1; 0 outside of a lesson's blocks.
    pub fn block(&self) -> u32 {
        self.lesson.as_ref().map_or(0, Lesson::block)
    }

    /// Begins the lesson of a segment, if it is one.
    pub(super) fn begin_lesson(
        &mut self,
        program: &Arc<Program>,
        segment: usize,
        begun_ns: u64,
        resumed: bool,
    ) {
        self.end_lesson();
        if let Some(step) = program.steps.get(segment)
            && let Some(plan) = &step.plan
        {
            self.tickets = self.tickets.wrapping_add(1);
            let ticket = self.tickets;
            self.lesson =
                Some(Lesson::new(ticket, &plan.timetable, self.rest[step.axis], begun_ns));
            let program = Arc::clone(program);
            self.push(Homework::Begin { ticket, program, segment: segment as u32, resumed });
        }
    }

    pub(super) fn end_lesson(&mut self) {
        if let Some(lesson) = self.lesson.take() {
            self.push(Homework::End(lesson));
        }
    }

    fn push(&mut self, homework: Homework) {
        if self.homework.len() < HOMEWORK {
            self.homework.push_back(homework);
        } else {
            // Nobody fetches it: to lose memory is better than to free it in the loop.
            std::mem::forget(homework);
        }
    }
}

/// What belongs to a lesson that is over goes back to the teacher.
fn give_back(homework: &mut VecDeque<Homework>, lecture: Lecture) {
    let mut give = |spent| {
        if homework.len() < HOMEWORK {
            homework.push_back(Homework::Spent(spent));
        } else {
            std::mem::forget(spent);
        }
    };
    let reference = match lecture {
        Lecture::Ready { takes: [first, second], reference, .. } => {
            give(Spent::Take(first));
            give(Spent::Take(second));
            reference
        }
        Lecture::Marked { take, reference, .. } => {
            give(Spent::Take(take));
            reference
        }
        Lecture::Failed { .. } => None,
    };
    if let Some(reference) = reference {
        give(Spent::Reference(reference));
    }
}
