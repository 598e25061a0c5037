// Limit on the energy that guidance gives to a hand.
#pragma once

#include <algorithm>

namespace haptrace {

/// A store of energy from which every active force draws (energy tanks: Secchi, Stramigioli and Fantuzzi 2006).
///
/// The tank starts full. The work of guidance on the hand, beyond the energy that its springs had stored, is charged.
/// The energy that dampers take from the hand, and the allowance of the path, are credited, up to the capacity. Active
/// forces are scaled by share(), which falls from 1 at a quarter of the capacity to 0 for an empty tank. Therefore they
/// never give more in total than the capacity and the credits.
///
/// Real-time: all.
class EnergyTank {
 public:
  explicit EnergyTank(double capacity) noexcept : capacity_(capacity), level_(capacity) {}

  /// Subtracts energy given to the hand [J]; a negative value was taken from the hand.
  void charge(double energy) noexcept { level_ = std::min(level_ - energy, capacity_); }
  void credit(double energy) noexcept { charge(-energy); }

  /// Returns the remaining energy [J]; below 0 if springs gave more than they held, as sampled springs can.
  [[nodiscard]] double level() const noexcept { return level_; }
  /// Returns the share of the active forces that may act, 0 to 1.
  [[nodiscard]] double share() const noexcept { return std::clamp(level_ / (kFull * capacity_), 0.0, 1.0); }

 private:
  static constexpr double kFull = 0.25;

  double capacity_, level_;
};

}  // namespace haptrace
