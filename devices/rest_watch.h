// Detection of a handle at rest after homing.
#pragma once

#include "base/types.h"

#include <cstdint>

namespace haptrace {

/// Detects when the handle has come to rest after homing. The user homes a device by pushing its handle, so the device
/// becomes ready in the middle of that push. The handle is at rest once it has stayed within kRadius for kRestNs, which
/// tremor does and a push does not.
///
/// Real-time.
class RestWatch {
 public:
  static constexpr double kRadius = 5e-3;               ///< [m]
  static constexpr std::int64_t kRestNs = 300'000'000;  ///< [ns]

  /// Starts a new watch while the device is not ready. The handle has to come to rest once the device is ready.
  void begin() noexcept {
    is_moving_ = true;
    place_ = nan3();
  }

  /// Takes every position of a ready device, with a time that does not go back [ns]. Returns whether the handle has
  /// come to rest since begin(); true if begin() was not called.
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
  Vec3 place_ = nan3();  ///< centre of the sphere that the handle must stay in [m]
  std::int64_t since_ns_ = 0;
};

}  // namespace haptrace
