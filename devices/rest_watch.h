// Is the handle at rest after its homing?
#pragma once

#include "base/types.h"

#include <cstdint>

namespace haptrace {

/// Homing is done by a hand that pushes the handle, and a device becomes ready in the middle of that push. This watch
/// answers when the handle has come to rest since: when it has stayed within kRadius for kRestNs, which tremor does and
/// a push does not.
///
/// Real-time.
class RestWatch {
 public:
  static constexpr double kRadius = 5e-3;               ///< [m]
  static constexpr std::int64_t kRestNs = 300'000'000;  ///< [ns]

  /// The device is not ready: the handle has to come to rest once it is.
  void begin() noexcept {
    is_moving_ = true;
    place_ = nan3();
  }

  /// With every position of a device that is ready; a time that does not go back [ns]. True without a begin before.
  bool update(const Vec3& position, std::int64_t now_ns) noexcept {
    if (!is_moving_) return true;
    if (!((position - place_).norm() <= kRadius)) {
      place_ = position;
      since_ns_ = now_ns;
    }
    is_moving_ = now_ns - since_ns_ < kRestNs;
    return !is_moving_;
  }

 private:
  bool is_moving_ = false;
  Vec3 place_ = nan3();  ///< where it came to rest [m]
  std::int64_t since_ns_ = 0;
};

}  // namespace haptrace
