// Errors outside the tick. Inside the tick nothing throws: results are [[nodiscard]] enums.
#pragma once

#include <stdexcept>
#include <string>
#include <string_view>

namespace haptrace {

/// Something a person has to act on. `what()` says what was wrong, where (file, row, key, option) and what to do.
class Error : public std::runtime_error {
 public:
  /// Whose turn it is, which is also what decides the command's exit code.
  enum class Kind {
    input,   ///< bad usage, bad input, an output that cannot be written: exit code 2
    device,  ///< the device is missing, refuses, or was lost: exit code 3
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

/// Throws Error(input), "WHAT is VALUE UNIT; it must be from LEAST to MOST UNIT", unless it is; NaN never is.
void check_range(std::string_view what, double value, double least, double most, std::string_view unit = "");

}  // namespace haptrace
