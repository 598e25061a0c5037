// Warnings as JSON: the key "warnings" of a session's --json, and the attribute `warnings` of a recording.
#pragma once

#include "control/warning.h"

#include <nlohmann/json.hpp>
#include <span>
#include <vector>

namespace haptrace {

/// Returns a list of {"severity": "note" | "warning" | "problem", "code", "time_s" (null without a time), "text"}.
nlohmann::json json_of(std::span<const Warning> warnings);

/// Reads the output of json_of(). Skips entries that are not warnings, since files come from anywhere.
std::vector<Warning> warnings_from(const nlohmann::json& list);

}  // namespace haptrace
