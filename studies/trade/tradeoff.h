// Trade-off of speed against accuracy: measures every setting, finds the best configurations and chooses one.
#pragma once

#include "studies/trade/budget.h"
#include "studies/trade/side_trades.h"
#include "studies/trade/workbench.h"

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

struct TradeOptions {
  Configuration base;        ///< base configuration, of which the sweeps change one setting at a time
  std::size_t runs = 3;      ///< runs of every configuration; those on the front get kFrontRuns times as many
  std::size_t threads = 0;   ///< 0: one for every core. Accuracy results do not depend on it
  bool instructions = true;  ///< count instructions, if possible
  bool search = true;        ///< search the front among combinations; else only sweep the settings
  std::vector<double> rates{100, 200, 500, 1000, 2000, 4000, 10000, 20000};  ///< [Hz]
};

inline constexpr std::size_t kFrontRuns = 2;

/// Configurations on the front are repeated until the half-width of the interval of error and ripple is at most this
/// share of the mean. They get at least kLeastRuns runs, and at most kMostRepeats * kFrontRuns times the requested
/// ones.
inline constexpr double kKnownInterval = 0.1;
inline constexpr std::size_t kLeastRuns = 4, kMostRepeats = 4;

/// One level of a setting, with the outcome of the base configuration at this level.
struct KnobLevel {
  std::string level;
  bool is_base = false;
  Outcome outcome;
};

struct KnobSweep {
  std::string knob;
  std::string what;  ///< one line of description
  std::vector<KnobLevel> levels;
};

/// A term of a session and the effect of leaving it out.
struct TermPrice {
  std::string term;
  Outcome without;
  double error_change = 0;     ///< change of the rms error [m]
  double ripple_change = 0;    ///< change of the ripple [N]
  double instructions = kNaN;  ///< instructions saved per tick
  double control = kNaN;       ///< time saved per tick [s]
  /// Without the term, every bounded measure changes by less than its bound, and no kept bound is broken.
  bool dispensable = false;
};

/// A configuration and the effect of leaving out each of its terms in turn.
struct Explanation {
  Outcome of;
  std::vector<TermPrice> terms;
};

/// Configuration chosen for a budget.
struct Choice {
  Outcome outcome;
  bool kept = false;         ///< keeps the budget; else the nearest configuration
  std::string binding;       ///< the tightest bound, as in "error<=0.1mm"; empty without one
  double binding_ratio = 0;  ///< Bound::ratio() of the tightest bound
  std::string excludes;      ///< bound that the next cheaper (dearer, if only costs are bounded) one breaks, or ""
  std::vector<std::string> implied;     ///< further bounds that the budget does not name
  std::optional<StorageLevel> storage;  ///< fastest storage that keeps a bound on the size of recordings
  std::optional<Outcome> cheaper;       ///< next configuration on the front that costs less
  std::optional<Outcome> dearer;        ///< next configuration that costs more
};

struct TradeReport {
  TradeOptions options;
  std::string device, path;
  double path_duration = 0;  ///< [s]
  bool calibrated = false;
  Outcome base;
  std::optional<Outcome> plain;  ///< the PD law alone at the base's rate, if playable
  std::vector<KnobSweep> sweeps;
  std::vector<SideTrade> sides;
  std::vector<Outcome> tried;  ///< all combinations, in the order of their trials
  std::vector<Outcome> front;  ///< ascending in load
  bool complete = true;        ///< false if it was stopped early
};

/// Called with the name of the stage and the finished share of the whole.
using TradeProgress = std::function<void(const std::string& stage, double done)>;

/// Changes every setting of the base by itself, then tries combinations: servo rate x compensations x learning, and for
/// the best of these estimators, interpolations and thinner paths. The front holds every combination that no other one
/// equals or beats in error, ripple, load and repetitions at once, if it improves error or ripple by at least one per
/// cent.
///
/// Equal options and workplaces give fronts whose accuracy results are bit-identical. The choice between configurations
/// of almost the same load may depend on the counted instructions. Calls `draw` with the intermediate report after the
/// sweeps. Throws what the Workbench throws.
TradeReport measure_trade(Workbench& bench, const TradeOptions& options, const StopRequest& stop,
                          const TradeProgress& progress = {}, const std::function<void(const TradeReport&)>& draw = {});

/// Sets bytes_per_hour of every outcome from the storage trade-off among the report's sides, for the default storage.
void weigh_recordings(TradeReport& report);

/// Smallest gain margin of a chosen configuration, unless the budget itself bounds the margin. It protects the user,
/// who has no say in the choice.
inline constexpr double kLeastMargin = 1.4;

/// Chooses a configuration from the front: the cheapest one that keeps the budget or, if the budget bounds only costs,
/// the most accurate one. If none keeps it, the one that exceeds its worst bound by the smallest factor. A budget
/// without a bound on the ripple gets the ripple of the plain law at the base's rate as a bound, if that law was
/// played, because buzzing forces can make an error small.
///
/// Returns nothing for an incomplete report or an empty front. A bound on the size of recordings needs the storage
/// trade-off among the report's sides.
std::optional<Choice> choose(const TradeReport& report, const Budget& budget);

/// Sets the changes from `outcome` to `price.without`, and whether the budget allows them.
void weigh(const Outcome& outcome, const Budget& budget, TermPrice& price);

/// Measures `configuration` without each of its terms in turn, with the runs and the instruction count that `options`
/// request. A stop ends it early with the results so far.
Explanation explain(const Workbench& bench, const Configuration& configuration, const Budget& budget,
                    const TradeOptions& options, const StopRequest& stop);

}  // namespace haptrace
