// Learning over the repetitions of one session.
#pragma once

#include "control/iterative_learning.h"

#include <atomic>
#include <semaphore>
#include <thread>
#include <vector>

namespace haptrace {

/// A LearnedForce that learns: what a repetition teaches is worked out while the device holds and goes back to the
/// start, by a thread of its own; in virtual time, where time stands still meanwhile, between two ticks.
///
/// Threads: force and between_ticks from the servo loop, the rest when it has ended. Real-time: force.
class LearningTerm final : public ForceTerm {
 public:
  struct Options {
    IterativeLearning::Options law;
    ForceTable known;      ///< from a model or an earlier session, or empty
    int known_counts = 0;  ///< as how many repetitions
    int repetitions = 0;   ///< to learn from; 0: what is known is used as it is
  };

  /// What became of a repetition. One for which there was no memory was skipped, of an unknown error.
  struct Lesson {
    IterativeLearning::Outcome outcome;
    double rms_error;  ///< measured [m]
  };

  /// Throws what IterativeLearning throws.
  explicit LearningTerm(const Options& options);
  ~LearningTerm() override;

  void start(const State& first) noexcept override { learned_.start(first); }
  [[nodiscard]] Vec3 force(const TermInput& input) noexcept override { return learned_.force(input); }
  void between_ticks(bool may_wait) noexcept override;

  /// Waits for what is still being worked out. After it, table and lessons are complete.
  void finish();
  [[nodiscard]] const ForceTable& table() const noexcept { return law_.table(); }
  [[nodiscard]] const std::vector<Lesson>& lessons() const noexcept { return lessons_; }

 private:
  enum class Work : int { none, waiting, done };

  void work() noexcept;
  void learn() noexcept;
  void use_newest() noexcept;

  IterativeLearning law_;
  int left_;  ///< repetitions to learn from
  LearnedForce learned_;
  ForceTable tables_[2];  ///< one in use, the other for the next
  int used_ = 0;
  RepetitionLog log_;  ///< of the repetition that is worked on
  std::vector<Lesson> lessons_;

  std::atomic<Work> state_{Work::none};
  std::counting_semaphore<> wake_{0};
  std::atomic<bool> ending_{false};
  std::jthread worker_;
};

const char* to_string(IterativeLearning::Outcome outcome) noexcept;

}  // namespace haptrace
