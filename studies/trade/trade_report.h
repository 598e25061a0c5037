// Report of a measured trade-off as JSON, text and plot.
#pragma once

#include "plot/figure.h"
#include "studies/trade/tradeoff.h"

namespace haptrace {

/// Returns the report in SI units.
nlohmann::json to_json(const TradeReport& report);
nlohmann::json to_json(const Choice& choice, const Budget& budget);
nlohmann::json to_json(const TermPrice& price);
nlohmann::json to_json(const Explanation& explanation);

/// Returns the outcome's predictions for `play`, with the keys of play's own JSON.
nlohmann::json predicted_by(const Outcome& outcome);

/// Returns tables of every setting with its levels, then of the front.
std::string text_of(const TradeReport& report);
std::string text_of(const Choice& choice, const Budget& budget);
/// `what` names the kind of the explanation's terms, as in "term".
std::string text_of(const Explanation& explanation, const Budget& budget, const char* what);

/// Returns a plot of error over load with the front, and of error, ripple and tick time over the levels of the numeric
/// settings. `choice` may be null.
Figure figure_of(const TradeReport& report, const Choice* choice);

}  // namespace haptrace
