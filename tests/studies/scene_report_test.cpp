#include "studies/scene_report.h"

#include "scene/scene_file.h"

#include <algorithm>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace haptrace {
namespace {

/// Returns a scene with a row of spheres that do not touch each other.
std::shared_ptr<Scene> row_of_spheres(int count) {
  nlohmann::json json{{"objects", nlohmann::json::array()}};
  for (int i = 0; i < count; ++i)
    json["objects"].push_back({{"kind", "sphere"},
                               {"name", "ball" + std::to_string(i)},
                               {"centre", {0.01 * i, 0, 0}},
                               {"radius", 0.004},
                               {"stiffness", 500}});
  return read_scene(json, "row.json");
}

std::ptrdiff_t lines_with(const std::string& text, const std::string& word) {
  std::ptrdiff_t lines = 0;
  for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++lines;
  return lines;
}

TEST(SceneReport, TouchesEveryObjectAndListsThemInTheirOrder) {
  const SceneReport report = report_scene(*row_of_spheres(3), 1000);
  ASSERT_EQ(report.objects.size(), 3U);
  for (const ObjectReport& object : report.objects) EXPECT_GT(object.touched_s, 0) << object.name;
  const std::string text = text_of(report);
  EXPECT_LT(text.find("ball0"), text.find("ball1"));
  EXPECT_LT(text.find("ball1"), text.find("ball2"));
}

TEST(SceneReport, ListsOnlyTheCostliestOfManyObjectsAndSaysHowManyMoreThereAre) {
  SceneReport report = report_scene(*row_of_spheres(3000), 1000);
  EXPECT_EQ(report.objects.size(), 3000U);
  EXPECT_TRUE(std::all_of(report.objects.begin(), report.objects.end(), [](const auto& o) { return o.touched_s > 0; }));
  report.objects[2718].touched_s = 1;
  const std::string text = text_of(report);
  EXPECT_NE(text.find("ball2718 "), std::string::npos);
  EXPECT_EQ(lines_with(text, "ball"), 40);
  EXPECT_NE(text.find("and 2960 more"), std::string::npos);
}

}  // namespace
}  // namespace haptrace
