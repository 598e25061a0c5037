// Formulas that a scene file states as a text.
#pragma once

#include "scene/interval.h"
#include "scene/jet.h"

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace haptrace {

/// A formula of up to three variables, compiled from a text such as "x^2 + y^2 + z^2 - 0.03^2".
///
/// It has the operators + - * / ^ (which binds to the right, and before a sign: -x^2 is -(x^2)), brackets, numbers, the
/// constants pi and e, and the functions sin cos tan asin acos atan exp log sqrt abs min max atan2. The derivatives are
/// exact. At the kinks of abs, min and max they are those of one side, or 0 in the middle of abs; sqrt has the
/// derivative 0 at 0. Outside a function's domain the value is NaN.
///
/// Real-time: all but the constructor and split().
class Expression {
 public:
  static constexpr std::size_t kMostCharacters = 4096, kMostInstructions = 512, kMostNumbers = 32;
  static constexpr int kMostNesting = 64;

  /// Throws Error(input) that states the column, and what is wrong or known there; or that no variable is in the text.
  /// `variables`: their names.
  Expression(std::string_view text, std::span<const std::string_view> variables);

  [[nodiscard]] double value(const Vec3& place) const noexcept;
  [[nodiscard]] Slope slope(const Vec3& place) const noexcept;
  [[nodiscard]] Jet jet(const Vec3& place) const noexcept;
  /// Returns bounds of the value in a box whose sides are these.
  [[nodiscard]] Interval over(Interval x, Interval y, Interval z) const noexcept;
  /// Returns bounds along the line from + t way, for t within `share`.
  [[nodiscard]] Span along(const Vec3& from, const Vec3& way, Interval share) const noexcept;

  /// Returns both sides of an expression of the form min(a, b) or max(a, b).
  struct Sides;
  [[nodiscard]] std::optional<Sides> split() const;

  /// Number of instructions, for reports.
  [[nodiscard]] std::size_t size() const noexcept { return code_.size(); }

  enum class Op : std::uint8_t {
    number,
    variable,  // push
    add_number,
    times_number,
    power,
    root_power,  // with a number
    inverse,
    sine,
    cosine,
    tangent,
    arc_sine,
    arc_cosine,
    arc_tangent,  // of one
    exponential,
    logarithm,
    square_root,
    magnitude,  //
    add,
    subtract,
    multiply,
    divide,
    raise,
    least,
    most,
    angle,  // of two
  };
  struct Instruction {
    Op op = Op::number;
    std::uint8_t index = 0;  ///< of a variable
    double number = 0;
  };

 private:
  Expression() = default;
  class Parser;
  std::vector<Instruction> code_;
};

struct Expression::Sides {
  bool least = false;  ///< min; otherwise max
  Expression a, b;
};

}  // namespace haptrace
