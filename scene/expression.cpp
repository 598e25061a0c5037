#include "scene/expression.h"

#include "base/error.h"
#include "base/suggest.h"
#include "base/text_file.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

using Op = Expression::Op;
using Instruction = Expression::Instruction;
using std::numbers::pi;

struct Function {
  const char* name;
  Op op;
  int arguments;
};

constexpr std::array kFunctions{
    Function{"sin", Op::sine, 1},        Function{"cos", Op::cosine, 1},      Function{"tan", Op::tangent, 1},
    Function{"asin", Op::arc_sine, 1},   Function{"acos", Op::arc_cosine, 1}, Function{"atan", Op::arc_tangent, 1},
    Function{"exp", Op::exponential, 1}, Function{"log", Op::logarithm, 1},   Function{"sqrt", Op::square_root, 1},
    Function{"abs", Op::magnitude, 1},   Function{"min", Op::least, 2},       Function{"max", Op::most, 2},
    Function{"atan2", Op::angle, 2},
};

constexpr int operands(Op op) noexcept {
  if (op <= Op::variable) return 0;
  return op < Op::add ? 1 : 2;
}

// --- Functions of one number, with their derivatives ---

/// Returns x^n of a whole number n.
double whole_power(double x, int n) noexcept {
  double factor = n < 0 ? 1 / x : x, result = 1;
  for (unsigned rest = static_cast<unsigned>(std::abs(n)); rest != 0; rest /= 2) {
    if (rest % 2 != 0) result *= factor;
    factor *= factor;
  }
  return result;
}

Unary power_and_slopes(double x, double c) noexcept {
  const int n = static_cast<int>(c);
  if (n == 0) return {1, 0, 0};
  if (n == 2) return {x * x, 2 * x, 2};
  return {whole_power(x, n), c * whole_power(x, n - 1), n == 1 ? 0 : c * (c - 1) * whole_power(x, n - 2)};
}

Unary with_slopes(const Instruction& step, double x) noexcept {
  switch (step.op) {
    case Op::power:
      return power_and_slopes(x, step.number);
    case Op::root_power: {
      const double c = step.number, f = std::pow(x, c);
      // At 0 the derivatives may be unbounded; 0 is the one of a symmetric root.
      if (x == 0) return {f, c > 1 ? c * std::pow(x, c - 1) : 0, c > 2 ? c * (c - 1) * std::pow(x, c - 2) : 0};
      return {f, c * f / x, c * (c - 1) * f / (x * x)};
    }
    case Op::inverse: {
      const double f = 1 / x;
      return {f, -f * f, 2 * f * f * f};
    }
    case Op::sine: {
      const double s = std::sin(x), c = std::cos(x);
      return {s, c, -s};
    }
    case Op::cosine: {
      const double s = std::sin(x), c = std::cos(x);
      return {c, -s, -c};
    }
    case Op::tangent: {
      const double t = std::tan(x), f1 = 1 + t * t;
      return {t, f1, 2 * t * f1};
    }
    case Op::arc_sine: {
      const double f1 = 1 / std::sqrt(1 - x * x);
      return {std::asin(x), f1, x * f1 * f1 * f1};
    }
    case Op::arc_cosine: {
      const double f1 = 1 / std::sqrt(1 - x * x);
      return {std::acos(x), -f1, -x * f1 * f1 * f1};
    }
    case Op::arc_tangent: {
      const double f1 = 1 / (1 + x * x);
      return {std::atan(x), f1, -2 * x * f1 * f1};
    }
    case Op::exponential: {
      const double f = std::exp(x);
      return {f, f, f};
    }
    case Op::logarithm:
      return {std::log(x), 1 / x, -1 / (x * x)};
    case Op::square_root: {
      const double f = std::sqrt(x);
      if (f == 0) return {f, 0, 0};
      return {f, 0.5 / f, -0.25 / (f * x)};
    }
    case Op::magnitude:
      return {std::abs(x), x > 0 ? 1.0 : x < 0 ? -1.0 : 0.0, 0};
    default:
      return {};
  }
}

/// Values alone: no derivative is computed that nobody asks for.
double applied(const Instruction& step, double x) noexcept {
  switch (step.op) {
    case Op::power:
      return step.number == 2 ? x * x : whole_power(x, static_cast<int>(step.number));
    case Op::root_power:
      return std::pow(x, step.number);
    case Op::inverse:
      return 1 / x;
    case Op::sine:
      return std::sin(x);
    case Op::cosine:
      return std::cos(x);
    case Op::tangent:
      return std::tan(x);
    case Op::arc_sine:
      return std::asin(x);
    case Op::arc_cosine:
      return std::acos(x);
    case Op::arc_tangent:
      return std::atan(x);
    case Op::exponential:
      return std::exp(x);
    case Op::logarithm:
      return std::log(x);
    case Op::square_root:
      return std::sqrt(x);
    case Op::magnitude:
      return std::abs(x);
    default:
      return x;
  }
}

template <class N>
N applied(const Instruction& step, const N& x) noexcept {
  return chained(x, with_slopes(step, value_of(x)));
}

Interval applied(const Instruction& step, Interval a) noexcept {
  constexpr double kUlps = 4;
  switch (step.op) {
    case Op::power: {
      const int n = static_cast<int>(step.number);
      if (n == 2) return square_of(a);
      return n >= 0 ? power_of(a, n) : inverse_of(power_of(a, -n));
    }
    case Op::root_power: {
      if (a.lo < 0) return kWholeLine;
      const double p = std::pow(a.lo, step.number), q = std::pow(a.hi, step.number);
      return widened(std::min(p, q), std::max(p, q), kUlps);
    }
    case Op::inverse:
      return inverse_of(a);
    case Op::sine:
      return sine_of(a);
    case Op::cosine:
      return sine_of(a + widened(pi / 2, pi / 2));
    case Op::tangent: {
      // Increasing between its poles at pi / 2 + k pi.
      const double pole = std::ceil((a.lo - pi / 2) / pi - 1e-12) * pi + pi / 2;
      if (!(a.most() < 1e9) || !(a.hi < pole - 1e-12 * (1 + a.most()))) return kWholeLine;
      return widened(std::tan(a.lo), std::tan(a.hi), kUlps);
    }
    case Op::arc_sine:
      return a.lo < -1 || a.hi > 1 ? kWholeLine : widened(std::asin(a.lo), std::asin(a.hi), kUlps);
    case Op::arc_cosine:
      return a.lo < -1 || a.hi > 1 ? kWholeLine : widened(std::acos(a.hi), std::acos(a.lo), kUlps);
    case Op::arc_tangent:
      return widened(std::atan(a.lo), std::atan(a.hi), kUlps);
    case Op::exponential:
      return widened(std::exp(a.lo), std::exp(a.hi), kUlps);
    case Op::logarithm:
      return a.lo > 0 ? widened(std::log(a.lo), std::log(a.hi), kUlps) : kWholeLine;
    case Op::square_root:
      return a.hi < 0 ? kWholeLine : widened(std::sqrt(std::max(0.0, a.lo)), std::sqrt(a.hi), kUlps);
    case Op::magnitude:
      return {a.has(0) ? 0 : std::min(std::abs(a.lo), std::abs(a.hi)), a.most()};
    default:
      return kWholeLine;
  }
}

/// Bounds of the derivative of a function of one number.
Interval slope_of(const Instruction& step, Interval a, Interval f) noexcept {
  switch (step.op) {
    case Op::power: {
      const int n = static_cast<int>(step.number) - 1;
      if (n == 1) return 2 * a;
      return step.number * (n >= 0 ? power_of(a, n) : inverse_of(power_of(a, -n)));
    }
    case Op::root_power: {
      if (!(a.lo > 0)) return kWholeLine;
      return step.number * (f * inverse_of(a));
    }
    case Op::inverse:
      return -square_of(f);
    case Op::sine:
      return sine_of(a + widened(pi / 2, pi / 2));
    case Op::cosine:
      return -sine_of(a);
    case Op::tangent:
      return Interval{1, 1} + square_of(f);
    case Op::arc_sine:
    case Op::arc_cosine: {
      if (!(a.lo > -1 && a.hi < 1)) return kWholeLine;
      const Interval square = Interval{1, 1} - square_of(a);
      const Interval slope = inverse_of(widened(std::sqrt(std::max(0.0, square.lo)), std::sqrt(square.hi)));
      return step.op == Op::arc_sine ? slope : -slope;
    }
    case Op::arc_tangent:
      return inverse_of(Interval{1, 1} + square_of(a));
    case Op::exponential:
      return f;
    case Op::logarithm:
      return inverse_of(a);
    case Op::square_root:
      return 0.5 * inverse_of(f);
    case Op::magnitude:
      return {a.lo >= 0 ? 1.0 : -1.0, a.hi <= 0 ? -1.0 : 1.0};
    default:
      return kWholeLine;
  }
}

Span applied(const Instruction& step, const Span& a) noexcept {
  const Interval f = applied(step, a.value);
  return {f, slope_of(step, a.value, f) * a.rate};
}

// --- Functions of two numbers ---

template <class N>
N joined(const Instruction& step, const N& a, const N& b) noexcept {
  const double x = value_of(a), y = value_of(b);
  switch (step.op) {
    case Op::add:
      return sum(a, b);
    case Op::subtract:
      return sum(a, scaled(b, -1));
    case Op::multiply:
      return chained(a, b, Binary{x * y, y, x, 0, 1, 0});
    case Op::divide: {
      const double r = 1 / y, f = x / y;
      return chained(a, b, Binary{f, r, -f * r, 0, -r * r, 2 * f * r * r});
    }
    case Op::raise: {
      const double f = std::pow(x, y), l = std::log(x), fa = y * f / x, fb = f * l;
      return chained(a, b, Binary{f, fa, fb, fa * (y - 1) / x, f / x + fb * y / x, fb * l});
    }
    case Op::least:
      return y < x || std::isnan(x) ? b : a;
    case Op::most:
      return y > x || std::isnan(x) ? b : a;
    case Op::angle: {  // of (y, x), in this order: x is the ordinate
      const double square = x * x + y * y, r = square > 0 ? 1 / square : 0;
      return chained(
          a, b,
          Binary{std::atan2(x, y), y * r, -x * r, -2 * x * y * r * r, (x * x - y * y) * r * r, 2 * x * y * r * r});
    }
    default:
      return a;
  }
}

/// Bounds of the angle of (ordinate, abscissa): at the corners of the rectangle, unless it holds the jump or the
/// origin.
Interval angle_of(Interval y, Interval x) noexcept {
  if (x.lo <= 0 && y.has(0)) return {-4, 4};
  Interval range{10, -10};
  for (const double b : {y.lo, y.hi})
    for (const double a : {x.lo, x.hi}) {
      const double angle = std::atan2(b, a);
      range = {std::min(range.lo, angle), std::max(range.hi, angle)};
    }
  return widened(range.lo, range.hi, 4);
}

Interval joined(const Instruction& step, Interval a, Interval b) noexcept {
  switch (step.op) {
    case Op::add:
      return a + b;
    case Op::subtract:
      return a - b;
    case Op::multiply:
      return a * b;
    case Op::divide:
      return a * inverse_of(b);
    case Op::raise:
      if (!(a.lo > 0)) return kWholeLine;
      {
        const Interval log = b * widened(std::log(a.lo), std::log(a.hi), 4);
        return widened(std::exp(log.lo), std::exp(log.hi), 4);
      }
    case Op::least:
      return least_of(a, b);
    case Op::most:
      return most_of(a, b);
    case Op::angle:
      return angle_of(a, b);
    default:
      return kWholeLine;
  }
}

Span joined(const Instruction& step, const Span& a, const Span& b) noexcept {
  const Interval f = joined(step, a.value, b.value);
  switch (step.op) {
    case Op::add:
      return {f, a.rate + b.rate};
    case Op::subtract:
      return {f, a.rate - b.rate};
    case Op::multiply:
      return {f, a.rate * b.value + a.value * b.rate};
    case Op::divide:
      return {f, (a.rate - f * b.rate) * inverse_of(b.value)};
    case Op::raise:
      if (!(a.value.lo > 0)) return {f, kWholeLine};
      return {f, f * (b.value * inverse_of(a.value) * a.rate +
                      widened(std::log(a.value.lo), std::log(a.value.hi), 4) * b.rate)};
    case Op::least:
      if (a.value.hi < b.value.lo) return a;
      if (b.value.hi < a.value.lo) return b;
      return {f, hull(a.rate, b.rate)};
    case Op::most:
      if (a.value.lo > b.value.hi) return a;
      if (b.value.lo > a.value.hi) return b;
      return {f, hull(a.rate, b.rate)};
    case Op::angle: {
      if (b.value.lo <= 0 && a.value.has(0)) return {f, kWholeLine};
      return {f, (b.value * a.rate - a.value * b.rate) * inverse_of(square_of(a.value) + square_of(b.value))};
    }
    default:
      return {f, kWholeLine};
  }
}

template <class N>
N constant(double number) noexcept {
  if constexpr (std::is_same_v<N, double>)
    return number;
  else if constexpr (std::is_same_v<N, Interval>)
    return {number, number};
  else if constexpr (std::is_same_v<N, Span>)
    return {{number, number}, {0, 0}};
  else
    return {number, {}};
}

/// Runs the program on a stack of numbers.
template <class N>
N run(std::span<const Instruction> code, const std::array<N, 3>& variables) noexcept {
  // The program writes every place before it reads it.
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-member-init)
  std::array<N, Expression::kMostNumbers> stack;
  std::size_t count = 0;
  for (const Instruction& step : code) {
    if (step.op == Op::number) {
      stack[count++] = constant<N>(step.number);
    } else if (step.op == Op::variable) {
      stack[count++] = variables[step.index];
    } else if (step.op == Op::add_number) {
      stack[count - 1] = shifted(stack[count - 1], step.number);
    } else if (step.op == Op::times_number) {
      stack[count - 1] = scaled(stack[count - 1], step.number);
    } else if (step.op < Op::add) {
      stack[count - 1] = applied(step, stack[count - 1]);
    } else {
      --count;
      stack[count - 1] = joined(step, stack[count - 1], stack[count]);
    }
  }
  return stack[0];
}

}  // namespace

// --- Compiling ---

class Expression::Parser {
 public:
  Parser(std::string_view text, std::span<const std::string_view> variables) : text_(text), variables_(variables) {
    if (text.size() > kMostCharacters)
      throw input_error(
          fmt::format("the expression has {} characters; at most {} are possible", text.size(), kMostCharacters));
  }

  std::vector<Instruction> parse() {
    sum(0);
    skip_blanks();
    if (at_ < text_.size())
      fail(text_[at_] == ')' ? "there is no '(' for this ')'" : "expected an operator (+ - * / ^) or the end");
    check_stack();
    check_variables();
    return std::move(code_);
  }

 private:
  using Start = std::size_t;  ///< first instruction of an operand

  [[noreturn]] void fail(const std::string& what) const { fail_at(at_, what); }
  [[noreturn]] static void fail_at(std::size_t at, const std::string& what) {
    throw input_error(fmt::format("column {}: {}", at + 1, what));
  }

  void skip_blanks() {
    while (at_ < text_.size() && (text_[at_] == ' ' || text_[at_] == '\t' || text_[at_] == '\n' || text_[at_] == '\r'))
      ++at_;
  }
  /// Returns the next character that is not blank; 0 at the end.
  char next() {
    skip_blanks();
    return at_ < text_.size() ? text_[at_] : '\0';
  }
  void expect(char wanted, const char* why) {
    if (next() != wanted) fail(fmt::format("expected '{}' {}", wanted, why));
    ++at_;
  }

  Start sum(int depth) {
    const Start start = product(depth);
    for (char c = next(); c == '+' || c == '-'; c = next()) {
      ++at_;
      const Start other = product(depth);
      emit_binary(c == '+' ? Op::add : Op::subtract, start, other);
    }
    return start;
  }

  Start product(int depth) {
    const Start start = signed_power(depth);
    for (char c = next(); c == '*' || c == '/'; c = next()) {
      ++at_;
      const Start other = signed_power(depth);
      emit_binary(c == '*' ? Op::multiply : Op::divide, start, other);
    }
    return start;
  }

  Start signed_power(int depth) {
    bool minus = false;
    for (char c = next(); c == '+' || c == '-'; c = next()) {
      minus = minus != (c == '-');
      ++at_;
    }
    const Start start = power(depth);
    if (minus) emit_scale(start, -1);
    return start;
  }

  Start power(int depth) {
    if (depth >= kMostNesting)
      fail(fmt::format("the expression nests deeper than {} levels; split it into fewer brackets", kMostNesting));
    const Start start = primary(depth);
    if (next() == '^') {
      const std::size_t sign = at_++;
      const Start exponent = signed_power(depth + 1);
      emit_power(start, exponent, sign);
    }
    return start;
  }

  Start primary(int depth) {
    const char c = next();
    const std::size_t begin = at_;
    if (c == '\0') fail("the expression ends where a number, a name or '(' is expected");
    if (c == '(') {
      ++at_;
      const Start start = sum(depth + 1);
      expect(')', fmt::format("for the '(' in column {}", begin + 1).c_str());
      return start;
    }
    if ((c >= '0' && c <= '9') || c == '.') return number();
    if (is_letter(c)) return name(depth);
    fail(fmt::format("expected a number, a name or '(', not {}", shown(c)));
  }

  static bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; }
  static std::string shown(char c) {
    const auto byte = static_cast<unsigned char>(c);
    return byte >= 0x20 && byte < 0x7f ? fmt::format("'{}'", c) : fmt::format("the byte {:#04x}", byte);
  }

  Start number() {
    const std::size_t begin = at_;
    const auto digits = [&] {
      const std::size_t first = at_;
      while (at_ < text_.size() && text_[at_] >= '0' && text_[at_] <= '9') ++at_;
      return at_ - first;
    };
    std::size_t count = digits();
    if (at_ < text_.size() && text_[at_] == '.') {
      ++at_;
      count += digits();
    }
    if (count == 0) fail_at(begin, "a number needs a digit");
    if (at_ < text_.size() && (text_[at_] == 'e' || text_[at_] == 'E')) {
      const std::size_t back = at_++;
      if (at_ < text_.size() && (text_[at_] == '+' || text_[at_] == '-')) ++at_;
      if (digits() == 0) at_ = back;
    }
    double value = 0;
    if (!parse_number(text_.substr(begin, at_ - begin), value) || !std::isfinite(value))
      fail_at(begin, "the number is too large");
    if (at_ < text_.size() && (is_letter(text_[at_]) || text_[at_] == '.'))
      fail(fmt::format("expected an operator after the number {}; write 2*x for twice x",
                       text_.substr(begin, at_ - begin)));
    return push({.op = Op::number, .number = value}, begin);
  }

  Start name(int depth) {
    const std::size_t begin = at_;
    while (at_ < text_.size() && (is_letter(text_[at_]) || (text_[at_] >= '0' && text_[at_] <= '9'))) ++at_;
    const std::string word(text_.substr(begin, at_ - begin));
    for (std::size_t i = 0; i < variables_.size(); ++i)
      if (word == variables_[i]) {
        names_variable_ = true;
        return push({.op = Op::variable, .index = static_cast<std::uint8_t>(i)}, begin);
      }
    if (word == "pi") return push({.op = Op::number, .number = pi}, begin);
    if (word == "e") return push({.op = Op::number, .number = std::numbers::e}, begin);
    const auto* function =
        std::find_if(kFunctions.begin(), kFunctions.end(), [&](const Function& f) { return word == f.name; });
    if (function == kFunctions.end()) fail_at(begin, fmt::format("unknown name '{}'{}", word, known(word)));
    expect('(', fmt::format("after the function {}", word).c_str());
    const Start start = sum(depth + 1);
    if (function->arguments == 2) {
      expect(',', fmt::format("between the two arguments of {}", word).c_str());
      const Start other = sum(depth + 1);
      expect(')', fmt::format("after the two arguments of {}", word).c_str());
      emit_binary(function->op, start, other);
    } else {
      expect(')', fmt::format("after the argument of {}", word).c_str());
      emit_unary({.op = function->op}, start);
    }
    return start;
  }

  [[nodiscard]] std::string known(const std::string& word) const {
    std::vector<std::string> names(variables_.begin(), variables_.end());
    names.insert(names.end(), {"pi", "e"});
    for (const Function& function : kFunctions) names.emplace_back(function.name);
    const std::string near = suggestion(word, names);
    std::string list;
    for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
    return near.starts_with("; known") ? "; known: " + list : near + "; known: " + list;
  }

  // Code: an operand that is a number is computed here, or becomes part of the instruction.

  Start push(const Instruction& step, std::size_t column) {
    if (code_.size() >= kMostInstructions)
      fail_at(column, fmt::format("the expression has more than {} operations", kMostInstructions));
    code_.push_back(step);
    return code_.size() - 1;
  }
  [[nodiscard]] bool is_number(Start start, Start end) const {
    return end == start + 1 && code_[start].op == Op::number;
  }
  void emit_scale(Start start, double factor) {
    if (is_number(start, code_.size()))
      code_[start].number *= factor;
    else
      push({.op = Op::times_number, .number = factor}, at_);
  }
  void emit_unary(const Instruction& step, Start start) {
    if (is_number(start, code_.size()))
      code_[start].number = applied(step, code_[start].number);
    else
      push(step, at_);
  }
  void emit_binary(Op op, Start start, Start other) {
    const bool left = is_number(start, other), right = is_number(other, code_.size());
    if (left && right) {
      code_[start].number = joined(Instruction{.op = op}, code_[start].number, code_[other].number);
      code_.pop_back();
    } else if (right && op <= Op::divide) {
      const double c = code_[other].number;
      code_.pop_back();
      if (op == Op::add || op == Op::subtract)
        push({.op = Op::add_number, .number = op == Op::add ? c : -c}, at_);
      else if (op == Op::multiply)
        push({.op = Op::times_number, .number = c}, at_);
      else
        push({.op = Op::times_number, .number = 1 / c}, at_);
    } else if (left && op <= Op::divide) {
      const double c = code_[start].number;
      code_.erase(code_.begin() + static_cast<std::ptrdiff_t>(start));
      if (op == Op::subtract) push({.op = Op::times_number, .number = -1}, at_);
      if (op == Op::divide) push({.op = Op::inverse}, at_);
      push({.op = op <= Op::subtract ? Op::add_number : Op::times_number, .number = c}, at_);
    } else {
      push({.op = op}, at_);
    }
  }
  void emit_power(Start start, Start exponent, std::size_t sign) {
    constexpr double kMostPower = 64;
    if (!is_number(exponent, code_.size())) {
      push({.op = Op::raise}, at_);
      return;
    }
    const double c = code_[exponent].number;
    code_.pop_back();
    if (!(std::abs(c) <= 1e6)) fail_at(sign, fmt::format("the exponent {} is too large", c));
    const bool whole = c == std::round(c) && std::abs(c) <= kMostPower;
    emit_unary({.op = whole ? Op::power : Op::root_power, .number = c}, start);
  }

  void check_stack() const {
    std::size_t count = 0, most = 0;
    for (const Instruction& step : code_) {
      count += 1;
      count -= static_cast<std::size_t>(operands(step.op));
      most = std::max(most, count);
    }
    if (most > kMostNumbers)
      throw input_error(
          fmt::format("the expression holds {} numbers at once; at most {} are possible. Write its "
                      "longest brackets first",
                      most, kMostNumbers));
  }

  void check_variables() const {
    if (names_variable_) return;
    std::string list;
    for (const std::string_view name : variables_) list += (list.empty() ? "" : ", ") + std::string(name);
    throw input_error("the expression has no variable; known: " + list);
  }

  std::string_view text_;
  std::span<const std::string_view> variables_;
  std::size_t at_ = 0;
  bool names_variable_ = false;
  std::vector<Instruction> code_;
};

Expression::Expression(std::string_view text, std::span<const std::string_view> variables)
    : code_(Parser(text, variables).parse()) {}

double Expression::value(const Vec3& place) const noexcept {
  return run<double>(code_, {place.x(), place.y(), place.z()});
}

Slope Expression::slope(const Vec3& place) const noexcept {
  return run<Slope>(
      code_, {coordinate<Slope>(place.x(), 0), coordinate<Slope>(place.y(), 1), coordinate<Slope>(place.z(), 2)});
}

Jet Expression::jet(const Vec3& place) const noexcept {
  return run<Jet>(code_, {coordinate<Jet>(place.x(), 0), coordinate<Jet>(place.y(), 1), coordinate<Jet>(place.z(), 2)});
}

Interval Expression::over(Interval x, Interval y, Interval z) const noexcept {
  return run<Interval>(code_, {x, y, z});
}

Span Expression::along(const Vec3& from, const Vec3& way, Interval share) const noexcept {
  std::array<Span, 3> variables{};
  for (int axis = 0; axis < 3; ++axis)
    variables[static_cast<std::size_t>(axis)] = {Interval{from[axis], from[axis]} + way[axis] * share,
                                                 {way[axis], way[axis]}};
  return run<Span>(code_, variables);
}

std::optional<Expression::Sides> Expression::split() const {
  if (code_.empty() || (code_.back().op != Op::least && code_.back().op != Op::most)) return {};
  // The second operand begins after the last place at which one number is on the stack.
  std::size_t count = 0, start = 0;
  for (std::size_t i = 0; i + 1 < code_.size(); ++i) {
    count += 1;
    count -= static_cast<std::size_t>(operands(code_[i].op));
    if (count == 1) start = i + 1;
  }
  Sides sides{code_.back().op == Op::least, {}, {}};
  const auto middle = code_.begin() + static_cast<std::ptrdiff_t>(start);
  sides.a.code_.assign(code_.begin(), middle);
  sides.b.code_.assign(middle, code_.end() - 1);
  return sides;
}

}  // namespace haptrace
