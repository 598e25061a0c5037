// Files of norms.
#include "formats/documents/norms.h"

#include "tests/formats/support.h"

#include <nlohmann/json.hpp>

namespace haptrace {
namespace {

nlohmann::json valid_norms() {
  return {{"haptrace_norms", 1},
          {"source", "A. Author 2024"},
          {"population", "healthy adults"},
          {"age", {20, 60}},
          {"device", "Falcon"},
          {"task", "circle"},
          {"mode", "free"},
          {"metrics",
           {{"contour_rms_m", {{"sd", 1e-3}, {"icc", 0.8}, {"range", {5e-4, 2e-3}}}},
            {"movement_time_s", {{"retest", {{1.0, 1.1}, {2.0, 2.2}, {3.0, 2.9}}}}}}}};
}

TEST(Norms, AreReadWithEveryKey) {
  const TempFolder folder;
  const Norms norms = load_norms(folder.write("norms.json", valid_norms().dump()));
  EXPECT_EQ(norms.source, "A. Author 2024");
  EXPECT_EQ(norms.population, "healthy adults");
  EXPECT_EQ(norms.age_to, 60);
  EXPECT_EQ(norms.mode, "free");
  const MetricNorm& contour = norms.metrics.at("contour_rms_m");
  EXPECT_EQ(contour.icc, 0.8);
  EXPECT_EQ(contour.high, 2e-3);
  EXPECT_FALSE(contour.mdc95);
  EXPECT_EQ(norms.metrics.at("movement_time_s").retest[1], (std::vector<double>{2.0, 2.2}));
}

TEST(Norms, AreRejectedWithTheKeyThatIsWrong) {
  const TempFolder folder;
  const auto refused = [&](const char* pointer, const nlohmann::json& value, const std::string& words) {
    nlohmann::json norms = valid_norms();
    const nlohmann::json::json_pointer at(pointer);
    if (value.is_null())
      norms.at(at.parent_pointer()).erase(at.back());
    else
      norms[at] = value;
    const std::string file = folder.write("norms.json", norms.dump());
    expect_error([&] { load_norms(file); }, Error::Kind::input, {file, words});
  };
  for (const char* key : {"source", "age", "device", "task", "mode", "metrics", "haptrace_norms"})
    refused((std::string("/") + key).c_str(), nullptr, key);
  refused("/haptrace_norms", 2, "haptrace_norms");
  refused("/source", "", "must not be empty");
  refused("/mode", "fre", "free");
  refused("/age", {60, 20}, "[from, to]");
  refused("/metrics/contour_rms_m/icc", 1.5, "less than 1");
  refused("/metrics/contour_rms_m/icc", 1, "less than 1");
  refused("/metrics/contour_rms_m/icc", nullptr, "sd and icc belong together");
  refused("/metrics/contour_rms_m/sem", 1e-3, "states the error twice");
  refused("/metrics/contour_rms_m/mdc", 1e-3, "mdc");
  refused("/metrics/contour_rms_m/sd", 0, "sd is 0, but every measurement has an error");
  refused("/metrics/sparc", nlohmann::json::object(), "states nothing");
  refused("/metrics/contour_rms_m/range", {2}, "[from, to]");
  refused("/metrics/movement_time_s/retest", {{1, 2}, {3}, {4, 5}}, "same number of sessions");
  refused("/metrics/movement_time_s/retest", {{1, 2}, {3, 4}}, "at least 3 persons");
  refused("/metrics/movement_time_s/retest/0/0", "x", "retest");
}

}  // namespace
}  // namespace haptrace
