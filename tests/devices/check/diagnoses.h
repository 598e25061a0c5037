// Matchers for diagnoses.
#pragma once

#include "devices/check/doctor.h"

#include <gmock/gmock.h>
#include <ostream>

namespace haptrace {

inline void PrintTo(const Diagnosis& diagnosis, std::ostream* out) {
  *out << to_string(diagnosis.severity) << " " << diagnosis.check << ": " << diagnosis.measured << " -> "
       << diagnosis.remedy;
}

namespace test {

inline Diagnosis find(const std::vector<Diagnosis>& diagnoses, const std::string& check) {
  for (const Diagnosis& diagnosis : diagnoses)
    if (diagnosis.check == check) return diagnosis;
  ADD_FAILURE() << "nothing about " << check;
  return {};
}

inline testing::Matcher<const Diagnosis&> finding(Severity severity,
                                                  const testing::Matcher<const std::string&>& measured,
                                                  const testing::Matcher<const std::string&>& remedy) {
  return testing::AllOf(testing::Field("severity", &Diagnosis::severity, severity),
                        testing::Field("measured", &Diagnosis::measured, measured),
                        testing::Field("remedy", &Diagnosis::remedy, remedy));
}

}  // namespace test
}  // namespace haptrace
