//! A walk is an ordinary function with a stack of its own (a coroutine), so that an integrator stays as it is: it calls a
//! [`Guide`] whose answers are those of [`Guide::sample_all`] and [`Guide::pdf_all`].

use crate::guide::{Guide, Guided, Query};
use corosensei::stack::DefaultStack;
use corosensei::{CoroutineResult, ScopedCoroutine, ScopedCoroutineRef, Yielder};
use photofit_sampling::Paths;
use photofit_scalar::Vec3f;
use std::cell::{Cell, Ref, RefCell};

/// Walks side by side: six vectors of vertices, of whose questions some are of one kind and some of the other. Times hardly differ from
/// 64 to 256.
const WALKS: usize = 96;
/// Bytes of the stack of a walk, of which a path takes a few thousand; what is never touched takes no memory.
const STACK: usize = 1 << 18;

thread_local! {
    /// Stacks of waves that have ended, for the next one.
    static STACKS: RefCell<Vec<DefaultStack>> = const { RefCell::new(Vec::new()) };
}

/// Walks all paths, or says false where there is no memory for their stacks.
pub(super) fn walk_all<G: Guide, P: Paths>(guide: &G, count: usize, paths: &P) -> bool {
    let mut stacks = STACKS.take();
    while stacks.len() < WALKS.min(count) {
        // What there is goes back: others need it, too.
        let Ok(stack) = DefaultStack::new(STACK) else { return false };
        stacks.push(stack);
    }
    let side_by_side = WALKS.min(count);
    let locals = (0..side_by_side).map(|_| RefCell::new(None)).collect();
    let wave = Wave { guide, paths, count, next: Cell::new(0), locals };
    wave.begin(&mut stacks[..side_by_side], None);
    STACKS.set(stacks);
    true
}

/// What a walk asks.
#[derive(Clone, Copy)]
enum Question {
    Sample([f32; 2]),
    Density(Vec3f),
}

/// What it is told.
#[derive(Clone, Copy)]
enum Answer {
    Nothing,
    Sample(Option<(Vec3f, f32)>),
    Density(f32),
}

/// Paths that are walked side by side.
struct Wave<'a, G: Guide, P> {
    guide: &'a G,
    paths: &'a P,
    count: usize,
    /// The path that begins next.
    next: Cell<usize>,
    /// What the answers at the present vertex of each walk share.
    locals: Vec<RefCell<Option<G::Local>>>,
}

/// Questions and answers of the walks.
struct Exchange {
    questions: Vec<Option<Question>>,
    answers: Vec<Answer>,
}

/// Walks that go on, one after another.
trait GoOn {
    fn go_on(&mut self, exchange: &mut Exchange);
}

/// One walk and those that began before it.
struct Walk<'a, 'w, 's> {
    before: Option<&'a mut dyn GoOn>,
    index: usize,
    walk: ScopedCoroutineRef<'w, Answer, Question, (), &'s mut DefaultStack>,
}

impl GoOn for Walk<'_, '_, '_> {
    fn go_on(&mut self, exchange: &mut Exchange) {
        if let Some(before) = &mut self.before {
            before.go_on(exchange);
        }
        if self.walk.done() {
            return;
        }
        exchange.questions[self.index] = match self.walk.resume(exchange.answers[self.index]) {
            CoroutineResult::Yield(question) => Some(question),
            CoroutineResult::Return(()) => None,
        };
    }
}

impl<G: Guide, P: Paths> Wave<'_, G, P> {
    /// Begins a walk on each of the stacks, each within the scope of those before it, and answers until all have ended.
    fn begin(&self, stacks: &mut [DefaultStack], before: Option<&mut dyn GoOn>) {
        let index = self.locals.len() - stacks.len();
        let Some((stack, stacks)) = stacks.split_first_mut() else {
            if let Some(walks) = before {
                self.answer(walks);
            }
            return;
        };
        ScopedCoroutine::with_stack(stack, |walk: &Yielder<Answer, Question>, _| self.walk(index, walk))
            .scope(|walk| self.begin(stacks, Some(&mut Walk { before, index, walk })));
    }

    /// The paths of one walk.
    fn walk(&self, index: usize, walk: &Yielder<Answer, Question>) {
        let local = &self.locals[index];
        let guide = Asking { guide: self.guide, walk, local, prepared: Cell::new(0) };
        while self.next.get() < self.count {
            let path = self.next.replace(self.next.get() + 1);
            self.paths.walk(path, &Guided(&guide));
        }
    }

    /// Answers until all walks have ended.
    fn answer(&self, walks: &mut dyn GoOn) {
        let n = self.locals.len();
        let mut exchange = Exchange { questions: vec![None; n], answers: vec![Answer::Nothing; n] };
        loop {
            walks.go_on(&mut exchange);
            let (mut samples, mut densities) = (Vec::new(), Vec::new());
            for (index, question) in exchange.questions.iter().enumerate() {
                let Some(question) = *question else { continue };
                let local = Ref::filter_map(self.locals[index].borrow(), Option::as_ref);
                let Ok(local) = local else { unreachable!("a walk asks where nothing is prepared") };
                match question {
                    Question::Sample(u) => samples.push((index, local, u)),
                    Question::Density(wi) => densities.push((index, local, wi)),
                }
            }
            if samples.is_empty() && densities.is_empty() {
                return;
            }
            let points: Vec<(&G::Local, [f32; 2])> = samples.iter().map(|(_, l, u)| (&**l, *u)).collect();
            let mut found = vec![None; points.len()];
            self.guide.sample_all(&points, &mut found);
            for ((index, ..), sample) in samples.iter().zip(found) {
                exchange.answers[*index] = Answer::Sample(sample);
            }
            let directions: Vec<(&G::Local, Vec3f)> =
                densities.iter().map(|(_, l, wi)| (&**l, *wi)).collect();
            let mut found = vec![0.0; directions.len()];
            self.guide.pdf_all(&directions, &mut found);
            for ((index, ..), density) in densities.iter().zip(found) {
                exchange.answers[*index] = Answer::Density(density);
            }
        }
    }
}

/// The guide as a walk sees it: questions suspend the walk.
struct Asking<'a, G: Guide> {
    guide: &'a G,
    walk: &'a Yielder<Answer, Question>,
    local: &'a RefCell<Option<G::Local>>,
    /// Vertices that were prepared.
    prepared: Cell<u64>,
}

/// What a walk holds of a vertex: the rest stays with the wave.
struct Prepared {
    share: f32,
    /// Which vertex of the walk it is.
    serial: u64,
}

impl<G: Guide> Asking<'_, G> {
    fn ask(&self, at: &Prepared, question: Question) -> Answer {
        assert_eq!(at.serial, self.prepared.get(), "a walk asks at the vertex that it prepared last");
        self.walk.suspend(question)
    }
}

impl<G: Guide> Guide for Asking<'_, G> {
    type Local = Prepared;

    fn local(&self, at: &Query) -> Prepared {
        let local = self.guide.local(at);
        let share = self.guide.share(&local);
        *self.local.borrow_mut() = Some(local);
        self.prepared.set(self.prepared.get() + 1);
        Prepared { share, serial: self.prepared.get() }
    }

    fn share(&self, at: &Prepared) -> f32 {
        at.share
    }

    fn sample(&self, at: &Prepared, u: [f32; 2]) -> Option<(Vec3f, f32)> {
        match self.ask(at, Question::Sample(u)) {
            Answer::Sample(sample) => sample,
            Answer::Nothing | Answer::Density(_) => unreachable!("a sample is asked for"),
        }
    }

    fn pdf(&self, at: &Prepared, wi: Vec3f) -> f32 {
        match self.ask(at, Question::Density(wi)) {
            Answer::Density(density) => density,
            Answer::Nothing | Answer::Sample(_) => unreachable!("a density is asked for"),
        }
    }
}
