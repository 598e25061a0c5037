// What a session may cost, and how exact it has to be.
#pragma once

#include "studies/trade/outcome.h"

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

struct Bound {
  Measure measure = Measure::error;
  double limit = 0;  ///< SI: at most, or of a measure of which more is better at least

  /// The outcome's value over the limit, or the limit over it: at most 1 when the bound is kept. Infinite for an
  /// outcome that did not run or was not measured.
  [[nodiscard]] double ratio(const Outcome& outcome) const;
};

struct Budget {
  std::vector<Bound> bounds;

  [[nodiscard]] bool empty() const noexcept { return bounds.empty(); }
  [[nodiscard]] bool bounds_accuracy() const;  ///< at least one bound is of what a configuration gives
  [[nodiscard]] bool limits(Measure measure) const;

  /// The largest ratio() of its bounds, and whose it is; nothing for an empty budget.
  struct Tightest {
    const Bound* bound;
    double ratio;
  };
  [[nodiscard]] std::optional<Tightest> tightest(const Outcome& outcome) const;
  [[nodiscard]] bool kept(const Outcome& outcome) const;
};

/// Reads "error<=0.1mm, ripple<=0.3N, tick<=2us": measures of outcome.h, <= or >= by their sense, numbers with the
/// units m, mm, um, N, mN, s, ms, us, ns, MIPS, MB/h, GB/h or none. Throws Error(input) naming the part.
Budget parse_budget(std::string_view text);

std::string to_string(const Bound& bound);
std::string to_string(const Budget& budget);

}  // namespace haptrace
