// Errors outside the servo tick. Code inside the tick does not throw: its results are [[nodiscard]] enums.
#pragma once

#include <stdexcept>
#include <string>
#include <string_view>

namespace haptrace {

/// An error for the user to act on. `what()` says what is wrong, where (file, row, key, option) and how to mend it.
class Error : public std::runtime_error {
 public:
  /// Cause of an error. It decides the exit code of the command.
  enum class Kind {
    input,   ///< bad usage, bad input, an output that cannot be written: exit code 2
    device,  ///< the device is missing, refuses a command, or was lost: exit code 3
    fault,   ///< a limit or a fault ended a running session: exit code 1
  };

  Error(Kind kind, const std::string& what) : std::runtime_error(what), kind_(kind) {}
  [[nodiscard]] Kind kind() const noexcept { return kind_; }

 private:
  Kind kind_;
};

inline Error input_error(const std::string& what) {
  return {Error::Kind::input, what};
}
inline Error device_error(const std::string& what) {
  return {Error::Kind::device, what};
}

/// Throws Error(input) unless `value` is from `least` to `most`; NaN is out of range. The message is "WHAT is VALUE
/// UNIT; it must be from LEAST to MOST UNIT".
void check_range(std::string_view what, double value, double least, double most, std::string_view unit = "");

}  // namespace haptrace
