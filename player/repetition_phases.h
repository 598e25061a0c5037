// The phases of a session that repeats a movement.
#pragma once

#include "control/controller.h"
#include "player/playback/approach.h"

#include <optional>

namespace haptrace {

/// Counts repetitions, each of which passes through approach (a minimum-jerk movement to where it starts), run and
/// hold. A controller decides when a run starts and ends, and how fast time passes.
///
/// Real-time.
class RepetitionPhases {
 public:
  /// `repetitions` 0: until stopped; `hold` [s] at the end of each; `approach_speed` at its peak [m/s].
  RepetitionPhases(int repetitions, double hold, double approach_speed) noexcept
      : repetitions_(repetitions), hold_(hold), approach_speed_(approach_speed) {}

  [[nodiscard]] Phase phase() const noexcept { return phase_; }
  [[nodiscard]] double elapsed() const noexcept { return elapsed_; }  ///< in the phase [s]
  [[nodiscard]] bool finished() const noexcept { return finished_; }
  [[nodiscard]] const Approach& approach() const noexcept { return approach_; }
  [[nodiscard]] bool approached() const noexcept { return elapsed_ >= approach_.duration(); }

  /// Starts the movement from `from` to `to` [m], which takes at least `shortest` [s].
  void begin_approach(const Vec3& from, const Vec3& to, double shortest = 0) noexcept {
    enter(Phase::approach);
    approach_ = Approach(from, to, approach_speed_, shortest);
  }

  /// Keeps where a run or a hold stands, so that the next approach leads back there.
  void interrupt() noexcept {
    if (phase_ != Phase::approach) interrupted_ = Interrupted{phase_, elapsed_};
  }
  [[nodiscard]] bool interrupted() const noexcept { return interrupted_.has_value(); }

  /// Continues what was interrupted, or starts the run.
  void end_approach() noexcept {
    enter(interrupted_ ? interrupted_->phase : Phase::run);
    if (interrupted_) elapsed_ = interrupted_->elapsed;
    interrupted_.reset();
  }

  /// Ends the run.
  void begin_hold() noexcept { enter(Phase::hold); }

  /// Returns the event of a run that starts.
  [[nodiscard]] Event repetition_event() const noexcept {
    return {.code = EventCode::repetition, .values = {static_cast<double>(repetition_), kNaN, kNaN}};
  }

  void pass(double step) noexcept { elapsed_ += step; }

  /// Ends the present repetition: the next one, if there is one, can start at once. An approach continues, because the
  /// next repetition starts at the same place; one that leads back into a repetition then ends it.
  void skip() noexcept {
    if (phase_ != Phase::approach) {
      enter(Phase::hold);
      elapsed_ = hold_;
    } else if (interrupted_) {
      interrupted_ = Interrupted{Phase::hold, hold_};
    } else {
      (void)count();
    }
  }

  /// Adds repetitions, unless they never end.
  void add(int repetitions) noexcept {
    if (repetitions_ > 0 && !finished_) repetitions_ += repetitions;
  }

  /// Returns true once a hold is over and another repetition is to start; after the last one the session is finished.
  [[nodiscard]] bool next_repetition() noexcept { return elapsed_ >= hold_ && !finished_ && count(); }

 private:
  struct Interrupted {
    Phase phase;
    double elapsed;  ///< [s]
  };

  /// Counts a repetition as done. Returns false after the last one.
  bool count() noexcept {
    ++repetition_;
    finished_ = finished_ || (repetitions_ > 0 && repetition_ >= repetitions_);
    return !finished_;
  }

  void enter(Phase phase) noexcept {
    phase_ = phase;
    elapsed_ = 0;
  }

  int repetitions_;
  double hold_, approach_speed_;
  Phase phase_ = Phase::approach;
  double elapsed_ = 0;
  bool finished_ = false;
  int repetition_ = 0;
  Approach approach_;
  std::optional<Interrupted> interrupted_;
};

}  // namespace haptrace
