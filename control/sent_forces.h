// The forces of the last ticks, as they act on a device that answers late.
#pragma once

#include "base/types.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace haptrace {

/// A ring of the forces that were sent at the last ticks. A force acts from its sending until the next one is sent;
/// with a delay of a fraction of a tick, two forces share the time between two ticks.
///
/// Real-time: all but the constructor.
class SentForces {
 public:
  /// Keeps as many forces as a delay of `longest` ticks needs, at least 0; all of them are zero.
  explicit SentForces(double longest) : forces_(static_cast<std::size_t>(longest) + 2, Vec3::Zero()) {}

  /// Replaces every force that was sent by `force` [N].
  void fill(const Vec3& force) noexcept { std::fill(forces_.begin(), forces_.end(), force); }

  /// Takes the force that the last tick sent [N].
  void push(const Vec3& force) noexcept {
    newest_ = newest_ + 1 < forces_.size() ? newest_ + 1 : 0;
    forces_[newest_] = force;
  }

  /// Returns the mean force [N] that acted since the last tick, when a force acts `delay` ticks after its sending; 0 to
  /// the longest delay.
  [[nodiscard]] Vec3 acted(double delay) const noexcept {
    const double whole = std::floor(delay), part = delay - whole;
    const std::size_t after = before(newest_, static_cast<std::size_t>(whole));
    return (1 - part) * forces_[after] + part * forces_[before(after, 1)];
  }

 private:
  [[nodiscard]] std::size_t before(std::size_t index, std::size_t ticks) const noexcept {
    return index >= ticks ? index - ticks : index + forces_.size() - ticks;
  }

  std::vector<Vec3> forces_;  ///< [N]
  std::size_t newest_ = 0;
};

}  // namespace haptrace
