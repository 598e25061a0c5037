// How plausible every point of a path is as the place of a trainee, from the movement of the hand so far.
#pragma once

#include "control/path/arc_path.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace haptrace {

/// Weighs all places of a path against each other by dynamic programming over arc length: a hidden Markov model, as in
/// map matching (Newson and Krumm, ACM GIS 2009). Costs are negative logarithms of probabilities; the best place has
/// cost 0. Linear costs of skipping and of going back make a step O(states), by two sweeps (Felzenszwalb, Huttenlocher
/// and Kleinberg, NIPS 2003).
///
/// A state s_j has two costs. A_j is the distance between hand and path; it is forgotten over 30 mm, so that a trainee
/// who draws a smaller or shifted copy for ever is not driven to another strand. B_j is kept: parts that were skipped,
/// backward movement and the direction of movement; it remembers the lap. With M = A + B and the movement dl of the
/// hand since the last update,
///
///     advance   M_j = min over i in j-r .. j of M_i,  r = 3 dl q,  q: net over whole movement of a hand with tremor
///     skip      M_j = min(M_j, M_{j-1} + w_skip h)         back   M_j = min(M_j, M_{j+1} + w_back h)
///     restart   M_j = min(M_j, min M + cap), 0.3 more behind the best;  B_j = min(B_j, min B + cap_kept)
///     observe   A_j = A_j exp(-dl / lambda) + w_d dl (sqrt(1 + (d_j / sigma)^2) - 1),  B_j += w_h dl min(1 - u .
///     t_j, 1.8 + u . t_j)
///
/// and A travels with the best predecessor. u and t_j are the chords of the hand and of the path over the last 6 mm.
/// Only movement counts: a hand that rests adds no evidence, however long. Neither does one that shakes at one spot:
/// its low pass of 3 Hz stays within 6 mm for a second in which it moves by 40 mm, where the path leads farther. All
/// lengths are those of a path whose box has a diagonal of 110 mm, and scale with it.
///
/// On a path longer than 1.5 m, only the states within 0.4 m of the best are weighed. The others are searched a few at
/// a time while the hand matches none of the weighed ones.
///
/// Real-time: all but the constructor. Threads: one at a time. The path must outlive this object.
class PlaceEvidence {
 public:
  /// `resolution` [m] of the measured positions: movement of less than five times as much is no evidence.
  explicit PlaceEvidence(const ArcPath& path, double resolution = 0);

  /// Restarts for a hand at `position` [m] that is expected at arc length `s` [m].
  void start(double s, const Vec3& position) noexcept;

  /// Takes the position of the hand [m], `dt` [s] after the last one. Returns true if it moved far enough for an
  /// update of the costs. The position must be finite.
  bool update(const Vec3& position, double dt) noexcept;

  struct Candidate {
    double s = 0;     ///< [m]
    double cost = 0;  ///< 0 for the best
  };
  [[nodiscard]] Candidate best() const noexcept { return {s_of(first_ + best_), 0}; }
  /// Returns the best place within `range` [m] of `s` [m].
  [[nodiscard]] Candidate best_within(double s, double range) const noexcept;
  /// Returns the next place, from `from` [m] on, that is farther than `range` [m] from `s` [m], costs less than `most`,
  /// and less than all its neighbours within 6 mm. Its cost is infinite if there is none.
  [[nodiscard]] Candidate next_rival(double from, double s, double range, double most) const noexcept;

  /// Returns the distance cost A of the state at `s` [m].
  [[nodiscard]] double recent(double s) const noexcept;
  /// Returns the place, farther than `range` [m] from `s` [m] and along which the path leads as it does at `s` (cosine
  /// above `same_way`), with the least distance cost A: where the hand has been lately, whatever its history says. Its
  /// cost is infinite if there is none.
  [[nodiscard]] Candidate nearest_lately(double s, double range, double same_way) const noexcept;

  /// A part of the path [m].
  struct Stretch {
    double from = 0, to = 0;
    bool operator==(const Stretch&) const = default;
  };
  static constexpr std::size_t kMostStretches = 16;
  /// Returns the parts of the path whose costs are below kPlausible, in order. Beyond kMostStretches, the last one
  /// covers the rest.
  [[nodiscard]] std::span<const Stretch> plausible() const noexcept { return {stretches_.data(), stretch_count_}; }
  static constexpr double kPlausible = 2;

  /// Returns the arc length in `stretch` whose tunnel is nearest to `position`, to within a state: that with the least
  /// distance minus radius, which is returned too.
  struct Nearest {
    double s = 0, depth = 0;  ///< [m]
  };
  [[nodiscard]] Nearest nearest_in(const Stretch& stretch, const Vec3& position) const noexcept;

  /// Returns the factor on all lengths: 1 for a path with a diagonal of 110 mm.
  [[nodiscard]] double scale() const noexcept { return scale_; }
  /// Returns the distance between neighbouring states [m].
  [[nodiscard]] double spacing() const noexcept { return spacing_; }
  [[nodiscard]] std::size_t states() const noexcept { return x_.size(); }

 private:
  struct Seen {
    Vec3 position;    ///< of the hand at an update [m]
    double step = 0;  ///< distance from the update before [m]
  };
  [[nodiscard]] double s_of(std::size_t state) const noexcept { return spacing_ * static_cast<double>(state); }
  [[nodiscard]] std::size_t state_at(double s) const noexcept;
  [[nodiscard]] bool windowed() const noexcept { return total_.size() < x_.size(); }
  [[nodiscard]] const Seen& seen(std::size_t ago) const noexcept {
    return seen_[(newest_ + seen_.size() - ago) % seen_.size()];
  }
  [[nodiscard]] Vec3 chord() const noexcept;
  /// Returns true if the hand shakes at one spot.
  [[nodiscard]] bool shakes() const noexcept;
  void advance(std::size_t reach) noexcept;
  void sweep() noexcept;
  void observe(const Vec3& position, double step) noexcept;
  void conclude() noexcept;
  void move_window() noexcept;
  void search(double step) noexcept;
  [[nodiscard]] double mismatch(std::size_t state) const noexcept;
  void jump_to(std::size_t state) noexcept;

  double scale_ = 1, spacing_ = 0, step_ = 0;
  Vec3 origin_ = Vec3::Zero();
  std::vector<float> x_, y_, z_, radius_;           ///< of every state, from the origin [m]
  std::vector<float> tx_, ty_, tz_;                 ///< chord of the path over the last 6 mm before each state
  std::vector<std::uint8_t> winds_;                 ///< 1: the path round the state stays as near as a hand that shakes
  std::vector<float> total_, kept_, forgotten_;     ///< M, B and A of the states in the window
  std::array<std::vector<std::int32_t>, 2> units_;  ///< scratch, as are the next two
  std::array<std::vector<float>, 2> carried_;
  std::vector<std::uint64_t> key_;
  std::size_t first_ = 0;  ///< first state of the window
  std::size_t best_ = 0;   ///< index of the best in the window

  std::array<Seen, 64> seen_;
  std::size_t newest_ = 0, seen_count_ = 0;
  Vec3 slow_ = Vec3::Zero(), slow_before_ = Vec3::Zero();  ///< low-passed hand, now and at the last update [m]
  Vec3 spot_ = Vec3::Zero();                               ///< near which the low-passed hand stays [m]
  double at_spot_ = 0, time_at_spot_ = 0;                  ///< movement there [m], and time [s]

  std::array<Stretch, kMostStretches> stretches_;
  std::size_t stretch_count_ = 0;
  double lost_ = 0;         ///< movement for which no state of the window has matched [m]
  std::size_t search_ = 0;  ///< next state to search
};

}  // namespace haptrace
