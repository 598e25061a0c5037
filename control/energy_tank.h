// What guidance may give to a hand, and no more.
#pragma once

#include <algorithm>

namespace haptrace {

/// A store of energy that every active force has to draw from (energy tanks: Secchi, Stramigioli and Fantuzzi 2006).
///
/// It begins full. What guidance does to the hand beyond what its springs had stored is charged; what dampers take from
/// the hand, and what the path itself allows for, is credited, up to the capacity. Forces that could go on drawing are
/// scaled by share(), which falls from 1 at a quarter of the capacity to 0 when it is empty: so they never give more in
/// all than the capacity and the credits.
///
/// Real-time: all.
class EnergyTank {
 public:
  explicit EnergyTank(double capacity) noexcept : capacity_(capacity), level_(capacity) {}

  /// Energy given to the hand [J]; negative when it was taken.
  void charge(double energy) noexcept { level_ = std::min(level_ - energy, capacity_); }
  void credit(double energy) noexcept { charge(-energy); }

  /// What there is left [J]; below 0 when springs gave what they never held, as sampled ones can.
  [[nodiscard]] double level() const noexcept { return level_; }
  /// Of the active forces that may act, 0 to 1.
  [[nodiscard]] double share() const noexcept { return std::clamp(level_ / (kFull * capacity_), 0.0, 1.0); }

 private:
  static constexpr double kFull = 0.25;

  double capacity_, level_;
};

}  // namespace haptrace
