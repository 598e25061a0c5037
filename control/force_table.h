// The force that a movement learned, and what its repetitions taught.
#pragma once

#include "base/types.h"

#include <vector>

namespace haptrace {

/// A force over the time along a path, at equal steps from its start.
struct ForceTable {
  double step = 0.004;      ///< step of the time along the path [s]
  std::vector<Vec3> force;  ///< [N]

  /// Returns the force at `time` [s] by linear interpolation, the end forces beyond the table, or zero if it is empty.
  ///
  /// Real-time.
  [[nodiscard]] Vec3 at(double time) const noexcept;
};

/// The effect of a repetition on the learned force, see IterativeLearning.
enum class LearningOutcome {
  learned,
  converged,  ///< the remaining error does not repeat; the table stays
  undone,     ///< this repetition was worse: the best table is restored
  softened,   ///< the feedback was softened, so that the loop was another one: the best table is restored
  skipped,    ///< the repetition was interrupted or paused: nothing can be learned from it
};

const char* to_string(LearningOutcome outcome) noexcept;

/// Result of one repetition. If the memory did not suffice, the outcome is `skipped` and the error NaN.
struct Lesson {
  LearningOutcome outcome;
  double rms_error;  ///< measured error [m]
};

}  // namespace haptrace
