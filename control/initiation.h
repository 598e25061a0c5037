// How a trainee began a repetition.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace haptrace {

/// Start of the movement in a repetition with a back wall: by the trainee, or by the wall.
enum class Initiator : std::uint8_t {
  none,    ///< the trainee did not move, not even when the wall pushed
  self,    ///< the trainee moved before the wall pushed
  helped,  ///< the trainee moved once the wall pushed
};

/// Returns "none", "self" or "helped".
constexpr const char* to_string(Initiator initiator) noexcept {
  constexpr std::array kNames{"none", "self", "helped"};
  return kNames[static_cast<std::size_t>(initiator)];
}

/// How a repetition began, and the work of the wall in it.
struct Initiation {
  Initiator initiator = Initiator::none;
  double waited = 0;  ///< from the start of the repetition until the trainee moved, or until now [s]
  double work = 0;    ///< of the wall on the hand [J]
};

}  // namespace haptrace
