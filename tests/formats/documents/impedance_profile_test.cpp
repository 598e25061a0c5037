#include "formats/documents/impedance_profile.h"

#include "tests/formats/support.h"

namespace haptrace {
namespace {

ImpedanceProfile profile_of(const std::string& name, const std::string& text) {
  const TempFolder folder;
  return load_impedance_profile(folder.write(name, text));
}

TEST(ImpedanceProfile, ReadsGainsByPlaceOrTimeAndIsLinearBetweenThem) {
  const ImpedanceProfile profile =
      profile_of("p.json", R"({"s": [0, 0.1, 0.2], "kp": [1000, [2000, 1000, 0], 500], "kd": [10, 20, 5]})");
  EXPECT_TRUE(profile.by_place);
  EXPECT_EQ(profile.gains_at(-1).kp, Vec3(1000, 1000, 1000));
  EXPECT_LT((profile.gains_at(0.05).kp - Vec3(1500, 1000, 500)).norm(), 1e-9);
  EXPECT_LT((profile.gains_at(0.05).kd - Vec3(15, 15, 15)).norm(), 1e-9);
  EXPECT_EQ(profile.gains_at(0.1).kp, Vec3(2000, 1000, 0));
  EXPECT_EQ(profile.gains_at(9).kd, Vec3(5, 5, 5));
  EXPECT_FALSE(profile_of("p.json", R"({"t": [0], "kp": [1000]})").by_place);
  EXPECT_LT((profile_of("p.json", R"({"t": [0], "kp": [1000]})").gains[0].kd - Vec3(12, 12, 12)).norm(), 1e-9)
      << "without kd, it is 12 ms kp";
}

TEST(ImpedanceProfile, ReadsColumnsOfACsvAndSkipsTheOthers) {
  const ImpedanceProfile one = profile_of("p.csv", "t,x,y,z,kp,note\n0,1,2,3,1000,a\n0.5,1,2,3,,b\n1,1,2,3,500,c\n");
  EXPECT_FALSE(one.by_place);
  ASSERT_EQ(one.at.size(), 2U) << "a row without a gain is skipped";
  EXPECT_LT((one.gains_at(0.5).kp - Vec3::Constant(750)).norm(), 1e-9);
  const ImpedanceProfile each =
      profile_of("p.csv", "# haptrace\ns,kpx,kpy,kpz,kdx,kdy,kdz\n\n0,1,2,3,4,5,6\n1,7,8,9,1,2,3\n");
  EXPECT_TRUE(each.by_place);
  EXPECT_EQ(each.gains[0].kp, Vec3(1, 2, 3));
  EXPECT_EQ(each.gains[1].kd, Vec3(1, 2, 3));
}

TEST(ImpedanceProfile, RejectsAnInvalidFileAndNamesTheKeyOrRow) {
  const auto expect = [](const char* name, const char* text, std::initializer_list<std::string> parts) {
    expect_error([&] { (void)profile_of(name, text); }, Error::Kind::input, parts);
  };
  expect("p.json", R"({"kp": [1]})", {"p.json", "either s", "or t"});
  expect("p.json", R"({"s": [0], "t": [0], "kp": [1]})", {"either s"});
  expect("p.json", R"({"s": [0]})", {"kp"});
  expect("p.json", R"({"s": [], "kp": []})", {"s: expected an array"});
  expect("p.json", R"({"s": [0, "1"], "kp": [1, 1]})", {"s: expected an array"});
  expect("p.json", R"({"s": [0, 1], "kp": [1]})", {"kp: expected an array of 2"});
  expect("p.json", R"({"s": [0, 1], "kp": [1, -1]})", {"kp[1]", "too small"});
  expect("p.json", R"({"s": [0, 1], "kp": [1, [1, 2]]})", {"kp[1]"});
  expect("p.json", R"({"s": [0, 0], "kp": [1, 1]})", {"0 does not come after 0", "s must increase"});
  expect("p.json", R"({"s": [0], "kp": [1], "kd": [5000]})", {"kd[0]", "too large"});
  expect("p.json", R"({"s": [0], "kp": [1], "ki": [1]})", {"ki"});
  expect("p.csv", "t,x\n0,1\n", {"p.csv", "kpx,kpy,kpz", "t, x"});
  expect("p.csv", "kp\n1\n", {"column t"});
  expect("p.csv", "t,kp\n0,1,2\n", {"p.csv:2", "3 columns"});
  expect("p.csv", "t,kp\n0,-1\n", {"p.csv:2", "kp of the x axis is -1"});
  expect("p.csv", "t,kp\nx,1\n", {"p.csv:2", "t is not a number"});
  expect("p.csv", "t,kp\n0,inf\n", {"p.csv:2"});
  expect("p.csv", "t,kp\n0,\n", {"no row states a gain"});
  expect("p.csv", "t,kp\n1,5\n0,5\n", {"t must increase"});
  expect("p.csv", "", {"p.csv"});
}

}  // namespace
}  // namespace haptrace
