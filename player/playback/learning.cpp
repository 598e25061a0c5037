#include "player/playback/learning.h"

#include <cmath>
#include <new>

namespace haptrace {
namespace {

/// Returns the log size for a repetition. A repetition that lasts longer than this allows was interrupted.
std::size_t rows_of(const LearningTerm::Options& options) {
  if (options.repetitions == 0) return 0;
  const IterativeLearning::Options& law = options.law;
  return static_cast<std::size_t>(std::ceil(1.1 * law.duration / law.speed * law.rate_hz)) + 64;
}

}  // namespace

LearningTerm::LearningTerm(const Options& options)
    : law_(options.law, options.known, options.known_counts),
      left_(options.repetitions),
      learned_(options.law.duration, rows_of(options)) {
  log_.reserve(rows_of(options));
  lessons_.reserve(static_cast<std::size_t>(left_));
  tables_[0] = tables_[1] = law_.table();
  learned_.use(&tables_[0]);
  if (left_ > 0) worker_ = std::jthread([this] { work(); });
}

LearningTerm::~LearningTerm() {
  finish();
}

void LearningTerm::finish() {
  if (!worker_.joinable()) return;
  ending_ = true;
  wake_.release();
  worker_.join();
}

void LearningTerm::between_ticks(bool may_wait) noexcept {
  if (state_.load(std::memory_order_acquire) == Work::done) use_newest();
  // While the worker still processes one repetition, the next is left out so that it does not overwrite the log.
  if (left_ == 0 || state_.load(std::memory_order_relaxed) != Work::none || !learned_.take_repetition(log_)) return;
  --left_;
  if (may_wait) {
    learn();
    use_newest();
  } else {
    state_.store(Work::waiting, std::memory_order_release);
    wake_.release();
  }
}

void LearningTerm::work() noexcept {
  while (true) {
    wake_.acquire();
    if (state_.load(std::memory_order_acquire) == Work::waiting) {
      learn();
      state_.store(Work::done, std::memory_order_release);
    }
    if (ending_) return;
  }
}

void LearningTerm::learn() noexcept {
  Lesson lesson{LearningOutcome::skipped, kNaN};
  try {
    lesson.outcome = law_.learn(log_);
    lesson.rms_error = law_.rms_error();
  } catch (const std::bad_alloc&) {
    // The session continues without this lesson.
  }
  lessons_.push_back(lesson);
  tables_[1 - used_].force = law_.table().force;  // both have the same length: no allocation
}

void LearningTerm::use_newest() noexcept {
  used_ = 1 - used_;
  learned_.use(&tables_[used_]);
  state_.store(Work::none, std::memory_order_relaxed);
}

}  // namespace haptrace
