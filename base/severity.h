// How serious a report to a person is: of a warning of a session, a finding in a file or a diagnosis of the machine.
#pragma once

#include <array>
#include <cstdint>

namespace haptrace {

enum class Severity : std::uint8_t {
  ok,       ///< nothing to do: a check that passed
  note,     ///< worth knowing
  warning,  ///< something is wrong, but the session continues, the file can be read, or the rate can be sustained
  problem,  ///< ended the session, lost data, contradicts the format, or keeps the machine from its task
};

/// Returns "ok", "note", "warning" or "problem".
constexpr const char* to_string(Severity severity) noexcept {
  constexpr std::array kNames{"ok", "note", "warning", "problem"};
  return kNames[static_cast<std::size_t>(severity)];
}

}  // namespace haptrace
