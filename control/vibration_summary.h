// Summary of what the protection from vibration saw and did in a session.
#pragma once

#include "base/types.h"

#include <array>
#include <cstdint>

namespace haptrace {

/// The rule of VibrationMonitor that raised an alarm, the most certain one first.
enum class VibrationRule : std::uint8_t {
  energy,       ///< the force above 20 Hz is large
  half_cycles,  ///< the force alternates regularly, faster than 15 Hz
  contacts,     ///< the tool bounces off the same wall faster than a hand can tap
  slow,         ///< the force alternates at 4.5 to 16 Hz, or the tool bounces slowly: a hand may do that as well
  torque,       ///< the torque above 20 Hz is large: the energy rule, see ForceGuard
};

inline constexpr int kVibrationRules = 5;

/// Observations and reactions of a session's ForceGuard.
struct VibrationSummary {
  bool watched = false;                      ///< false if the session sent no force or the guard was off
  double share = 1;                          ///< share of the feedback at the end
  double worst_ripple = 0;                   ///< largest rms of the force above 20 Hz over about 50 ms [N]
  double frequency_hz = kNaN;                ///< frequency of the last alarm that caused a reaction
  double ripple = kNaN;                      ///< ripple of the same alarm [N]
  std::array<int, kVibrationRules> steps{};  ///< steps down, by VibrationRule
  bool ended = false;                        ///< true if the session ended because the vibration persisted
};

}  // namespace haptrace
