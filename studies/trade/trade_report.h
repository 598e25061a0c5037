// A measured trade as JSON, in words and as a picture.
#pragma once

#include "plot/figure.h"
#include "studies/trade/tradeoff.h"

namespace haptrace {

/// SI.
nlohmann::json to_json(const TradeReport& report);
nlohmann::json to_json(const Choice& choice, const Budget& budget);
nlohmann::json to_json(const TermPrice& price);
nlohmann::json to_json(const Explanation& explanation);

/// What the outcome predicts for `play`, by the names that play's own JSON has.
nlohmann::json predicted_by(const Outcome& outcome);

/// Tables for people: every knob with its levels, then the front.
std::string text_of(const TradeReport& report);
std::string text_of(const Choice& choice, const Budget& budget);
/// `what` each of the explanation's terms is, as in "term".
std::string text_of(const Explanation& explanation, const Budget& budget, const char* what);

/// Error against load with the front, and error, ripple and tick time over the levels of the knobs that have an order.
/// `choice` may be null.
Figure figure_of(const TradeReport& report, const Choice* choice);

}  // namespace haptrace
