// What repeats from one repetition of a movement to the next, learned.
#pragma once

#include "control/pd.h"

#include <memory>
#include <optional>
#include <vector>

namespace haptrace {

/// A force along the time of a path, at equal steps from its start.
struct ForceTable {
  double step = 0.004;      ///< of the path's time [s]
  std::vector<Vec3> force;  ///< [N]

  /// Linear between the rows, the first and last beyond them; nothing when it is empty.
  ///
  /// Real-time.
  [[nodiscard]] Vec3 at(double time) const noexcept;
};

/// One repetition as it was driven, a row per tick of phase run.
struct RepetitionLog {
  std::vector<double> time;        ///< of the path [s], not falling
  std::vector<Vec3> position;      ///< measured [m]
  std::vector<Vec3> reference;     ///< [m]
  std::vector<Vec3> acceleration;  ///< of the reference [m/s^2]
  std::vector<Vec3> known;         ///< what other terms cancel of the load [N]
  std::vector<Vec3> sent;          ///< by this tick, after all limits [N]

  void reserve(std::size_t rows);
  void clear() noexcept;
  [[nodiscard]] std::size_t size() const noexcept { return time.size(); }
  [[nodiscard]] bool full() const noexcept { return time.size() == time.capacity(); }
};

/// The force that a load along a path asks for, learned from repetitions.
///
/// After each repetition, the load that was met is what of the sent force the mass did not take,
///
///     met(t) = Q[u(t) - known(t) - M x_d''(s)] + M Q[e]''(s),   s = t + delay + T / 2,   e = x_d - x
///
/// with known what other terms cancel, Q a zero-phase low pass (Butterworth, forwards and backwards; of what is small
/// at a path's ends, so that it may be cut out of a movement), and the table becomes (1 - lambda) table + lambda met.
/// Since u = M x_d'' + known + table + feedback, this is table + lambda Q[L e] with L e = M e'' + feedback: the
/// learning law of Bristow, Tharayil and Alleyne (2006) with the loop's own inverse as L; it converges wherever the
/// load is softer than the loop. lambda is 1, then 4/5, 4/9, 4/13, ...: the mean of the repetitions, the first of
/// which, driven along another way, counts for a quarter. In the mean, what does not repeat cancels; it is left to the
/// disturbance observer.
///
/// It watches what it does. With e_j the error of repetition j, (e_j - e_j-1) / 2 is what does not repeat and
/// (e_j + e_j-1) / 2 what does: once the latter holds less than kNoise of the squares of both, there is nothing left to
/// learn. A repetition that is worse than the best by kWorse undoes what made it so: the best table is taken again, and
/// from then on steps are half as long.
///
/// Threads: one at a time. Not for the tick.
class IterativeLearning {
 public:
  struct Options {
    Vec3 mass = Vec3::Zero();  ///< [kg]
    double delay = 0;          ///< [s]
    double rate_hz = 1000;     ///< of the servo loop
    double speed = 1;          ///< of the path's time
    double cutoff_hz = 15;     ///< of each pass of Q
    double duration = 0;       ///< of the path [s]
  };

  enum class Outcome {
    learned,
    converged,  ///< what is left does not repeat; the table stays
    undone,     ///< this repetition was worse: the best table is back
    skipped,    ///< the repetition was interrupted or paused: nothing can be learned of it
  };

  static constexpr double kNoise = 0.03;
  static constexpr double kWorse = 1.3;
  static constexpr double kLongest = 600;  ///< seconds of session that may be learned

  /// Begins with `known`, from a model or an earlier session, which counts as much as `repetitions`; it may be empty.
  /// Throws Error(input) when an option is out of its range.
  explicit IterativeLearning(const Options& options, ForceTable known = {}, int repetitions = 0);

  /// The repetition that was driven with table(). It allocates: std::bad_alloc leaves the table as it was.
  Outcome learn(const RepetitionLog& log);

  [[nodiscard]] const ForceTable& table() const noexcept { return table_; }
  [[nodiscard]] int repetitions() const noexcept { return repetitions_; }  ///< that were learned from
  [[nodiscard]] double rms_error() const noexcept { return rms_; }         ///< of the last repetition, measured [m]

 private:
  [[nodiscard]] std::vector<Vec3> met_load(const RepetitionLog& log) const;
  [[nodiscard]] bool only_noise(const std::vector<Vec3>& error) const;

  Options options_;
  ForceTable table_, best_;
  std::vector<Vec3> error_;  ///< of the last repetition, along the table's steps [m]
  double rms_ = 0, best_rms_ = 0;
  double caution_ = 1;  ///< of the steps
  int repetitions_;
};

/// Sends what was learned along the path, without a step when the table or the path's time jumps. On the way to the
/// path and at its end it keeps to the table's ends.
///
/// It also writes down what of a repetition is needed to learn from it. The terms before it are what else is known of
/// the load.
///
/// Threads: the tick's; table and log change hands between ticks. Real-time: force.
class LearnedForce final : public ForceTerm {
 public:
  /// For a path that lasts `duration` [s] and is followed in at most `rows` ticks; longer repetitions are not written
  /// down. With 0 rows none is.
  LearnedForce(double duration, std::size_t rows) : duration_(duration) { log_.reserve(rows); }

  /// After a gap in a session: nothing can be learned of the repetition that it fell into.
  void start(const State& first) noexcept override;
  [[nodiscard]] Vec3 force(const TermInput& input) noexcept override;

  /// Between ticks: from now on. The table must live until the next one is set.
  void use(const ForceTable* table) noexcept { table_ = table; }

  /// Between ticks: whether a repetition ended since it was last asked. It is then in `log`, whose memory is taken for
  /// the next one: it must have been reserved for as many rows.
  [[nodiscard]] bool take_repetition(RepetitionLog& log) noexcept;

 private:
  void write_down(const TermInput& input) noexcept;

  const ForceTable* table_ = nullptr;
  Vec3 value_ = Vec3::Zero();   ///< sent last, without its share [N]
  Vec3 offset_ = Vec3::Zero();  ///< to the table, fading [N]
  const ForceTable* used_ = nullptr;
  bool on_path_ = false;

  enum class Writing { waiting, writing, broken, last_row, ended, taken };
  double duration_;
  RepetitionLog log_;
  Writing writing_ = Writing::waiting;
};

}  // namespace haptrace
