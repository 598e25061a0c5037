// Learning of the force that repeats from one repetition of a movement to the next.
#pragma once

#include "control/force_table.h"
#include "control/force_term.h"
#include "control/inertia_map.h"

#include <memory>
#include <optional>
#include <vector>

namespace haptrace {

/// Log of one repetition, with a sample per tick of phase run.
struct RepetitionLog {
  std::vector<double> time;        ///< time along the path [s], not decreasing
  std::vector<Vec3> position;      ///< measured [m]
  std::vector<Vec3> reference;     ///< [m]
  std::vector<Vec3> acceleration;  ///< acceleration of the reference [m/s^2]
  std::vector<Vec3> known;         ///< part of the load that other terms cancel [N]
  std::vector<Vec3> sent;          ///< force sent by this tick, after all limits [N]
  std::size_t softened = 0;        ///< ticks in which a monitor softened the feedback
  bool vibrated = false;           ///< because it vibrated

  void reserve(std::size_t rows);
  void clear() noexcept;
  [[nodiscard]] std::size_t size() const noexcept { return time.size(); }
  [[nodiscard]] bool full() const noexcept { return time.size() == time.capacity(); }
};

/// Learns the force that a load along a path requires, from repetitions.
///
/// After each repetition, the load met(t) is the part of the sent force that did not accelerate the mass,
///
///     met(t) = Q[u(t) - known(t) - M x_d''(s)] + M Q[e]''(s),   s = t + delay + T / 2,   e = x_d - x
///
/// where `known` is the force that other terms cancel and Q a zero-phase low pass (Butterworth, forwards and
/// backwards). Q filters signals that are small at a path's ends, so that the path may be cut out of a movement. The
/// table becomes (1 - lambda) table + lambda met. Since u = M x_d'' + known + table + feedback, this is table + lambda
/// Q[L e] with L e = M e'' + feedback: the learning law of Bristow, Tharayil and Alleyne (2006) with the loop's own
/// inverse as L. It converges wherever the load is softer than the loop. lambda is 1, then 4/5, 4/9, 4/13, ...: the
/// mean of the repetitions, in which the first, driven along another path, counts for a quarter. The mean cancels the
/// part of the load that does not repeat, which is left to the disturbance observer.
///
/// The class checks its own progress. With e_j the error of repetition j, (e_j - e_j-1) / 2 is the part that does not
/// repeat and (e_j + e_j-1) / 2 the part that does. Once the squares of the latter exceed those of the former by less
/// than kNoise of their sum, there is nothing left to learn. If a repetition is worse than the best by the factor
/// kWorse, the best table is restored, and later steps are half as long. A repetition in which a monitor softened the
/// feedback shows another loop: nothing is learned from it, the best table is restored as well, and the next repetition
/// is the first of which the later ones must not be worse, since another law may drive it. A table of an earlier
/// session under which the first kDistrusted repetitions were all softened may be the cause: it is forgotten.
///
/// Threads: one at a time. Not for the tick.
class IterativeLearning {
 public:
  struct Options {
    Vec3 mass = Vec3::Zero();             ///< [kg]
    double delay = 0;                     ///< [s]
    double rate_hz = 1000;                ///< of the servo loop
    double speed = 1;                     ///< of the path's time
    double cutoff_hz = 15;                ///< of each pass of Q
    double duration = 0;                  ///< of the path [s]
    std::optional<InertiaMap> inertia{};  ///< of the mass
  };

  static constexpr double kNoise = 0.03;
  static constexpr double kWorse = 1.3;
  static constexpr int kDistrusted = 2;
  static constexpr double kLongest = 600;  ///< longest repetition that can be learned, in time of the session [s]

  /// Starts from `known`, a table from a model or an earlier session that counts as `repetitions` repetitions; it may
  /// be empty. Throws Error(input) if an option is out of its range.
  explicit IterativeLearning(const Options& options, ForceTable known = {}, int repetitions = 0);

  /// Learns from a repetition that was driven with table(). Allocates; std::bad_alloc leaves the table unchanged.
  LearningOutcome learn(const RepetitionLog& log);

  [[nodiscard]] const ForceTable& table() const noexcept { return table_; }
  [[nodiscard]] int repetitions() const noexcept { return repetitions_; }  ///< number of repetitions learned from
  [[nodiscard]] double rms_error() const noexcept { return rms_; }  ///< rms error of the last repetition, measured [m]

 private:
  [[nodiscard]] std::vector<Vec3> met_load(const RepetitionLog& log) const;
  [[nodiscard]] bool only_noise(const std::vector<Vec3>& error) const;

  Options options_;
  ForceTable table_, best_;
  std::vector<Vec3> error_;  ///< error of the last repetition, at the table's steps [m]
  double rms_ = 0, best_rms_ = 0;
  double caution_ = 1;  ///< factor on the size of the steps
  int repetitions_;
  bool trusted_;      ///< the table is not of an earlier session, or drove a repetition that was not softened
  int softened_ = 0;  ///< repetitions of a table that is not trusted
};

/// Sends the learned force along the path, without a step when the table or the time along the path jumps. During the
/// approach and at the end of the path it keeps to the table's ends.
///
/// It also logs the data of a repetition that learning needs. The terms before it give the rest of the known load.
///
/// Threads: that of the tick; table and log change hands between ticks. Real-time: force.
class LearnedForce final : public ForceTerm {
 public:
  /// Serves a path that lasts `duration` [s] and takes at most `rows` ticks; longer repetitions are not logged. With 0
  /// rows, nothing is logged.
  LearnedForce(double duration, std::size_t rows) : duration_(duration) { log_.reserve(rows); }

  /// Discards the repetition into which a gap fell; called after a gap in a session.
  void start(const State& first) noexcept override;
  [[nodiscard]] Vec3 force(const TermInput& input) noexcept override;

  /// Uses `table` from now on. Call it between ticks. The table must live until the next one is set.
  void use(const ForceTable* table) noexcept { table_ = table; }

  /// Returns true if a repetition has ended since the last call, and moves it to `log`. Call it between ticks. The
  /// memory of `log` takes the next repetition: it must be reserved for as many rows.
  [[nodiscard]] bool take_repetition(RepetitionLog& log) noexcept;

 private:
  void write_down(const TermInput& input) noexcept;

  const ForceTable* table_ = nullptr;
  Vec3 value_ = Vec3::Zero();   ///< last force, before its share is applied [N]
  Vec3 offset_ = Vec3::Zero();  ///< difference from the table, fading [N]
  const ForceTable* used_ = nullptr;
  bool on_path_ = false;

  enum class Writing { waiting, writing, broken, last_row, ended, taken };
  double duration_;
  RepetitionLog log_;
  Writing writing_ = Writing::waiting;
};

}  // namespace haptrace
