// Bounds on the cost and the error of a session.
#pragma once

#include "studies/trade/outcome.h"

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

struct Bound {
  Measure measure = Measure::error;
  double limit = 0;  ///< SI; an upper bound, or a lower one for a measure of which more is better

  /// Returns the outcome's value divided by the limit, or the limit divided by it: at most 1 if the bound is kept.
  /// Infinite for an outcome that did not run or was not measured.
  [[nodiscard]] double ratio(const Outcome& outcome) const;
};

struct Budget {
  std::vector<Bound> bounds;

  [[nodiscard]] bool empty() const noexcept { return bounds.empty(); }
  [[nodiscard]] bool bounds_accuracy() const;  ///< at least one bound limits an accuracy measure
  [[nodiscard]] bool limits(Measure measure) const;

  /// The bound with the largest ratio().
  struct Tightest {
    const Bound* bound;
    double ratio;
  };
  [[nodiscard]] std::optional<Tightest> tightest(const Outcome& outcome) const;
  [[nodiscard]] bool kept(const Outcome& outcome) const;
};

/// Reads "error<=0.1mm, ripple<=0.3N, tick<=2us": measures of outcome.h, <= or >= by their sense, numbers with the
/// units m, mm, um, N, mN, s, ms, us, ns, MIPS, MB/h, GB/h or none. Throws Error(input) that names the part.
Budget parse_budget(std::string_view text);

/// Throws Error(input) if the budget bounds a measure that needs counted instructions.
void check_counted(const Budget& budget);

std::string to_string(const Bound& bound);
std::string to_string(const Budget& budget);

}  // namespace haptrace
