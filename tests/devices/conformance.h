// Common parts of the tests of a device's conformance.
#pragma once

#include "devices/check/conformance.h"

#include <algorithm>
#include <string>
#include <vector>

namespace haptrace::test {

/// An absent user that allows every force except the refused ones and records the requests and findings.
class ConsentingUser : public ConformanceUser {
 public:
  bool consents = true;
  std::vector<std::string> refused;      ///< words in the descriptions of the forces to refuse
  std::vector<std::string> asked, told;  ///< requested forces; ids of the findings

  [[nodiscard]] bool is_there() const override { return false; }
  bool allows(const std::string& force) override {
    asked.push_back(force);
    return consents && std::none_of(refused.begin(), refused.end(),
                                    [&](const std::string& words) { return force.find(words) != std::string::npos; });
  }
  bool does(const std::string& /*request*/) override { return false; }
  std::optional<bool> answers(const std::string& /*question*/) override { return std::nullopt; }
  void found(const LawFinding& finding) override { told.push_back(finding.id); }
};

/// Returns options for the shortest useful test, on a machine that runs other tests at the same time.
inline ConformanceOptions hasty_options() {
  return {.rest = 0.3, .busy_machine = true, .realtime = false};
}

/// Returns the findings, one per line.
inline std::string describe(const ConformanceReport& report) {
  std::string text = report.device.name + "\n";
  for (const LawFinding& finding : report.findings)
    text += std::string(to_string(finding.verdict)) + " " + finding.id + ": " + finding.detail + "\n";
  return text;
}

}  // namespace haptrace::test
