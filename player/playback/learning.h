// Iterative learning over the repetitions of a session.
#pragma once

#include "control/force_table.h"
#include "control/iterative_learning.h"

#include <atomic>
#include <semaphore>
#include <thread>
#include <vector>

namespace haptrace {

/// A LearnedForce that learns during the session. A worker thread processes each repetition while the device holds and
/// returns to the start. In virtual time, which stands still meanwhile, the work is done between two ticks.
///
/// Threads: force and between_ticks from the servo loop, the rest after it has ended. Real-time: force.
class LearningTerm final : public ForceTerm {
 public:
  struct Options {
    IterativeLearning::Options law;
    ForceTable known;      ///< initial force from a model or an earlier session, or empty
    int known_counts = 0;  ///< number of repetitions that `known` counts as
    int repetitions = 0;   ///< repetitions to learn from; 0: `known` is used unchanged
  };

  /// Throws what IterativeLearning throws.
  explicit LearningTerm(const Options& options);
  ~LearningTerm() override;

  void start(const State& first) noexcept override { learned_.start(first); }
  [[nodiscard]] Vec3 force(const TermInput& input) noexcept override { return learned_.force(input); }
  void between_ticks(bool may_wait) noexcept override;

  /// Waits for the worker thread to finish. Afterwards table and lessons are complete.
  void finish();
  [[nodiscard]] const ForceTable& table() const noexcept { return law_.table(); }
  [[nodiscard]] const std::vector<Lesson>& lessons() const noexcept { return lessons_; }

 private:
  enum class Work : int { none, waiting, done };

  void work() noexcept;
  void learn() noexcept;
  void use_newest() noexcept;

  IterativeLearning law_;
  int left_;  ///< remaining repetitions to learn from
  LearnedForce learned_;
  ForceTable tables_[2];  ///< one in use, the other for the next result
  int used_ = 0;
  RepetitionLog log_;  ///< log of the repetition in work
  std::vector<Lesson> lessons_;

  std::atomic<Work> state_{Work::none};
  std::counting_semaphore<> wake_{0};
  std::atomic<bool> ending_{false};
  std::jthread worker_;
};

}  // namespace haptrace
