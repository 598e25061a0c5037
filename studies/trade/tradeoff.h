// The trade of speed against accuracy: every knob measured, the best configurations found, one of them chosen.
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
  Configuration base;        ///< from which every knob is turned, one at a time
  std::size_t runs = 3;      ///< of every configuration, and kFrontRuns times as many of those on the front
  std::size_t threads = 0;   ///< 0: one for every core. What configurations give does not depend on it
  bool instructions = true;  ///< count them, where that is possible
  bool search = true;        ///< look for the front among combinations; else knobs only
  std::vector<double> rates{100, 200, 500, 1000, 2000, 4000, 10000, 20000};  ///< [Hz]
};

inline constexpr std::size_t kFrontRuns = 2;

/// Configurations on the front are run until half of the interval of error and ripple is at most this share of them, at
/// least kLeastRuns and at most kMostRepeats times kFrontRuns as often as was asked.
inline constexpr double kKnownInterval = 0.1;
inline constexpr std::size_t kLeastRuns = 4, kMostRepeats = 4;

/// One level of a knob. Its outcome is that of the base with this level.
struct KnobLevel {
  std::string level;
  bool is_base = false;
  Outcome outcome;
};

struct KnobSweep {
  std::string knob;
  std::string what;  ///< one line for people
  std::vector<KnobLevel> levels;
};

/// A term that a session is made of, and what is lost without it.
struct TermPrice {
  std::string term;
  Outcome without;
  double error_change = 0;     ///< of the rms error [m]
  double ripple_change = 0;    ///< [N]
  double instructions = kNaN;  ///< that are saved, of a tick
  double control = kNaN;       ///< time that is saved, of a tick [s]
  /// Its absence changes nothing that the budget bounds by as much as the bound, and breaks no bound that is kept.
  bool dispensable = false;
};

/// A configuration, and each of its terms left out in turn.
struct Explanation {
  Outcome of;
  std::vector<TermPrice> terms;
};

/// A configuration that was chosen for a budget.
struct Choice {
  Outcome outcome;
  bool kept = false;         ///< else it is the nearest that can be had
  std::string binding;       ///< the tightest bound, as in "error<=0.1mm"; empty without one
  double binding_ratio = 0;  ///< of the value that is expected to the bound
  std::string excludes;  ///< the bound that the next cheaper (where only costs are bounded, dearer) one breaks, or ""
  std::vector<std::string> implied;  ///< bounds that the budget does not name
  std::optional<StorageLevel>
      storage;                     ///< of recordings, when the budget bounds their size: the quickest that keeps it
  std::optional<Outcome> cheaper;  ///< the next on the front that costs less, if there is one
  std::optional<Outcome> dearer;   ///< the next that costs more
};

struct TradeReport {
  TradeOptions options;
  std::string device, path;
  double path_duration = 0;  ///< [s]
  bool calibrated = false;
  Outcome base;
  std::optional<Outcome> plain;  ///< the PD law alone at the base's rate, when it could be played
  std::vector<KnobSweep> sweeps;
  std::vector<SideTrade> sides;
  std::vector<Outcome> tried;  ///< every combination, in the order of trying
  std::vector<Outcome> front;  ///< ascending in load, descending in error
  bool complete = true;        ///< false when it was stopped before its end
};

/// How far it is: the stage in words, and the part of the whole that is done.
using TradeProgress = std::function<void(const std::string& stage, double done)>;

/// Turns every knob of the base by itself, then tries combinations: servo rate x compensations x learning, and for the
/// best of these estimators, interpolations and thinner paths. The front holds every combination that no other beats or
/// equals in error, ripple, load and repetitions at once, as far as it is worth a hundredth of the error.
///
/// Equal options and workplaces give fronts that are bit-identical in what they give; which of two configurations of
/// almost the same load is on it may follow the instructions that were counted. `draw` is called with what there is
/// after the knobs. Throws what the Workbench throws.
TradeReport measure_trade(Workbench& bench, const TradeOptions& options, const StopRequest& stop,
                          const TradeProgress& progress = {}, const std::function<void(const TradeReport&)>& draw = {});

/// Fills in what an hour of recording weighs, of every outcome, from the trade of storage among the report's sides, as
/// it is stored without being asked.
void weigh_recordings(TradeReport& report);

/// Whoever holds the motor is not asked what he bears: a configuration with less margin is never chosen, unless the
/// budget itself bounds the margin.
inline constexpr double kLeastMargin = 1.4;

/// A budget that does not bound the ripple keeps that of the plain law at the base's rate, as far as that was played: a
/// small error alone can be had by forces that buzz.
///
/// From the front: the cheapest that keeps the budget, or if that bounds nothing but costs the most exact that does;
/// where none does, the one whose worst bound is exceeded by the least factor. Nothing of a report that is not
/// complete, or whose front is empty. A bound on the bytes of a recording needs the trade of storage among the report's
/// sides.
std::optional<Choice> choose(const TradeReport& report, const Budget& budget);

/// Fills in what `price.without` changes of `outcome`, and whether the budget allows it.
void weigh(const Outcome& outcome, const Budget& budget, TermPrice& price);

/// As the options say of runs and instructions, as far as it comes until it is stopped.
Explanation explain(const Workbench& bench, const Configuration& configuration, const Budget& budget,
                    const TradeOptions& options, const StopRequest& stop);

}  // namespace haptrace
