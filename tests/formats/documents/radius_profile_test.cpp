#include "formats/documents/radius_profile.h"

#include "tests/formats/support.h"

namespace haptrace {
namespace {

TEST(RadiusProfile, IsLinearBetweenItsPoints) {
  const TempFolder folder;
  const RadiusProfile profile =
      load_radius_profile(folder.write("r.json", R"({"s": [0.1, 0.2, 0.4], "radius": [0.01, 0.002, 0.006]})"));
  EXPECT_DOUBLE_EQ(profile.at(0), 0.01);
  EXPECT_DOUBLE_EQ(profile.at(0.1), 0.01);
  EXPECT_NEAR(profile.at(0.15), 0.006, 1e-15);
  EXPECT_DOUBLE_EQ(profile.at(0.2), 0.002);
  EXPECT_NEAR(profile.at(0.25), 0.003, 1e-15);
  EXPECT_DOUBLE_EQ(profile.at(9), 0.006);
}

TEST(RadiusProfile, NamesWhatIsWrongWithAFile) {
  const TempFolder folder;
  const auto expect_refused = [&](const std::string& text, std::initializer_list<std::string> parts) {
    const std::string file = folder.write("r.json", text);
    expect_error([&] { (void)load_radius_profile(file); }, Error::Kind::input, parts);
  };
  expect_refused(R"({"s": [0, 1]})", {"r.json: 'radius' is missing"});
  expect_refused(R"({"s": [], "radius": []})", {"r.json: s: expected an array of lengths"});
  expect_refused(R"({"s": [0, 1], "radius": [0.01, -0.01]})", {"radius: expected an array of lengths from 0 to 1 m"});
  expect_refused(R"({"s": [0, "a"], "radius": [0.01, 0.01]})", {"s: expected an array"});
  expect_refused(R"({"s": [0, 1], "radius": [0.01]})", {"s has 2 values and radius has 1;"});
  expect_refused(R"({"s": [0, 1, 1], "radius": [0.01, 0.01, 0.01]})",
                 {"s[2]: 1 does not come after 1; s must increase"});
  expect_refused(R"({"s": [0], "radius": [0.01], "x": 1})", {"key 'x'"});
}

}  // namespace
}  // namespace haptrace
