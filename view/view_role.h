// Roles of the people who look at a live view.
#pragma once

#include <array>
#include <cstdint>

namespace haptrace {

enum class ViewRole : std::uint8_t {
  viewer,     ///< looks at a recording
  therapist,  ///< sees everything of a session, and changes it if that is allowed
  trainee,    ///< sees the exercise
};

/// Returns "viewer", "therapist" or "trainee".
constexpr const char* to_string(ViewRole role) noexcept {
  constexpr std::array kNames{"viewer", "therapist", "trainee"};
  return kNames[static_cast<std::size_t>(role)];
}

}  // namespace haptrace
