#include "devices/falcon/calibration.h"

#include "base/json_reader.h"
#include "tests/devices/support.h"
#include "tests/support/allocations.h"

#include <gmock/gmock.h>

namespace haptrace::test {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

FalconCalibration read(const char* text) {
  return read_falcon_calibration(json::parse(text), "my.json");
}

std::string refusal(const char* text) {
  return error_of([&] { (void)read(text); });
}

Vec3 torques_of(const std::array<std::int16_t, 3>& words, const FalconCalibration& falcon) {
  const Vec3 counts(words[0], words[1], words[2]);
  return counts.cwiseQuotient(falcon.motor_sign.cwiseProduct(falcon.counts_per_n_m));
}

TEST(FalconCalibration, TurnsCountsIntoAnglesFromWhereALegIsHomed) {
  FalconCalibration falcon;
  EXPECT_EQ(falcon.angles({0, 0, 0}), falcon.home_angle);
  // Its sources give 0.0364347 degrees per count.
  const Vec3 turned = falcon.angles({1000, 0, -1000}) - falcon.home_angle;
  EXPECT_NEAR(turned[0] * 180 / std::numbers::pi, 36.4347, 5e-4);
  EXPECT_EQ(turned[1], 0);
  EXPECT_NEAR(turned[2], -turned[0], 1e-12);

  falcon.encoder_sign = Vec3(1, 1, -1);
  falcon.counts_per_rad = Vec3(1000, 2000, 4000);
  falcon.home_angle = Vec3(0.1, 0.2, 0.3);
  EXPECT_LT((falcon.angles({500, 500, 500}) - Vec3(0.6, 0.45, 0.175)).norm(), 1e-12);
  EXPECT_TRUE(is_finite(falcon.angles({-32768, 32767, -32768})));
}

TEST(FalconCalibration, KeepsTheDirectionOfAForceThatIsTooLarge) {
  const FalconCalibration falcon;
  const FalconKinematics kinematics(falcon.geometry);
  Gaussian random(1, 1);
  int bounded = 0;
  for (int i = 0; i < 5000; ++i) {
    const Vec3 place = falcon.workspace.cwiseProduct(random.vector().cwiseMin(1.0).cwiseMax(-1.0));
    const FalconPose pose = *kinematics.at_position(falcon.origin + place);
    const Vec3 force = std::pow(10.0, i % 5) * random.vector();
    const auto words = falcon.motors(pose.torques(force));
    const Vec3 obtained = pose.jacobian.transpose().inverse() * torques_of(words, falcon);
    for (const std::int16_t word : words) ASSERT_LE(std::abs(word), 4095);
    const bool whole = (obtained - force).norm() < 0.02;  // half a count of each motor
    if (whole) continue;
    ++bounded;
    ASSERT_EQ(std::max({std::abs(words[0]), std::abs(words[1]), std::abs(words[2])}), 4095) << force.transpose();
    ASSERT_LT(obtained.norm(), force.norm());
    ASSERT_GT(obtained.normalized().dot(force.normalized()), 1 - 1e-4) << force.transpose();
  }
  EXPECT_GT(bounded, 1000);
  EXPECT_LT(bounded, 4500);
}

TEST(FalconCalibration, SendsNothingForTorquesThatAreNotFinite) {
  const FalconCalibration falcon;
  EXPECT_THAT(falcon.motors(Vec3::Zero()), ElementsAre(0, 0, 0));
  EXPECT_THAT(falcon.motors(Vec3(kNaN, 0.1, 0.1)), ElementsAre(0, 0, 0));
  EXPECT_THAT(falcon.motors(Vec3(0.1, INFINITY, 0.1)), ElementsAre(0, 0, 0));
  EXPECT_THAT(falcon.motors(Vec3(0.1, -0.05, 0)), ElementsAre(-1000, 500, 0));
  EXPECT_THAT(falcon.motors(Vec3(1e300, 0, 0)), ElementsAre(-4095, 0, 0));
}

TEST(FalconCalibration, RequestsLightsAndHomingWithSeparateBits) {
  FalconCalibration falcon;
  EXPECT_EQ(falcon.flags({}, false), 0);
  EXPECT_EQ(falcon.flags({}, true), 0x01);
  EXPECT_EQ(falcon.flags({.green = true}, false), 0x02);
  EXPECT_EQ(falcon.flags({.blue = true}, false), 0x04);
  EXPECT_EQ(falcon.flags({.red = true, .blue = true}, true), 0x0d);
  falcon = read(R"({"flags": {"homing": 16, "red": 1}})");
  EXPECT_EQ(falcon.flags({.red = true, .green = true}, true), 0x13);
}

TEST(FalconCalibration, AllocatesNothingInATick) {
  const FalconCalibration falcon;
  const std::size_t before = allocations();
  const Vec3 angles = falcon.angles({1, 2, 3});
  const auto words = falcon.motors(Vec3(0.1, 0.2, 3));
  EXPECT_EQ(allocations(), before);
  EXPECT_TRUE(is_finite(angles));
  EXPECT_EQ(words[2], -4095);
}

TEST(FalconCalibration, KeepsItsDefaultsForMissingKeys) {
  const FalconCalibration falcon = read(R"({"counts_per_n_m": [9000, 9100, 9200], "geometry": {"thigh": 0.061}})");
  EXPECT_EQ(falcon.counts_per_n_m, Vec3(9000, 9100, 9200));
  EXPECT_EQ(falcon.geometry.thigh, 0.061);
  EXPECT_EQ(falcon.geometry.shin, FalconGeometry().shin);
  EXPECT_EQ(falcon.counts_per_rad, FalconCalibration().counts_per_rad);
  EXPECT_EQ(falcon.max_motor_counts, 4095);
}

TEST(FalconCalibration, HasASampleOfEveryKeyAndItsDefault) {
  const json sample = load_json(SAMPLE_DEVICES "/falcon.json");
  const FalconCalibration sampled = read_falcon_calibration(sample, "falcon.json"), falcon;
  const auto near = [](const Vec3& a, const Vec3& b) { return (a - b).norm() < 1e-6 * std::max(1.0, b.norm()); };
  EXPECT_TRUE(near(sampled.geometry.azimuths, falcon.geometry.azimuths));
  EXPECT_TRUE(near(sampled.counts_per_rad, falcon.counts_per_rad));
  EXPECT_TRUE(near(sampled.home_angle, falcon.home_angle));
  EXPECT_EQ(sampled.geometry.thigh, falcon.geometry.thigh);
  EXPECT_EQ(sampled.geometry.shin, falcon.geometry.shin);
  EXPECT_EQ(sampled.geometry.shin_offset, falcon.geometry.shin_offset);
  EXPECT_EQ(sampled.geometry.handle_radius, falcon.geometry.handle_radius);
  EXPECT_EQ(sampled.geometry.handle_offset, falcon.geometry.handle_offset);
  EXPECT_EQ(sampled.geometry.base_radius, falcon.geometry.base_radius);
  EXPECT_EQ(sampled.geometry.base_offset, falcon.geometry.base_offset);
  EXPECT_EQ(sampled.encoder_sign, falcon.encoder_sign);
  EXPECT_EQ(sampled.counts_per_n_m, falcon.counts_per_n_m);
  EXPECT_EQ(sampled.motor_sign, falcon.motor_sign);
  EXPECT_EQ(sampled.max_motor_counts, falcon.max_motor_counts);
  EXPECT_EQ(sampled.flags({true, false, false}, false), falcon.flags({true, false, false}, false));
  EXPECT_EQ(sampled.flags({false, true, false}, true), falcon.flags({false, true, false}, true));
  EXPECT_EQ(sampled.flags({false, false, true}, true), falcon.flags({false, false, true}, true));
  EXPECT_EQ(sampled.origin, falcon.origin);
  EXPECT_EQ(sampled.workspace, falcon.workspace);
  EXPECT_EQ(sampled.max_force, falcon.max_force);
  // The sample has every known key and no other.
  EXPECT_EQ(sample.size(), 11);
  EXPECT_EQ(sample["geometry"].size(), 8);
  EXPECT_EQ(sample["flags"].size(), 4);
}

TEST(FalconCalibration, RejectsUnknownKeysAndSuggestsTheNearest) {
  EXPECT_THAT(refusal(R"({"counts_per_nm": 1e4})"),
              AllOf(HasSubstr("my.json"), HasSubstr("did you mean 'counts_per_n_m'?")));
  EXPECT_THAT(refusal(R"({"geometry": {"thig": 0.06}})"), HasSubstr("did you mean 'thigh'?"));
  EXPECT_THAT(refusal(R"({"flags": {"gren": 2}})"), HasSubstr("did you mean 'green'?"));
  EXPECT_THAT(refusal("[]"), HasSubstr("my.json: expected an object"));
}

TEST(FalconCalibration, RejectsInvalidValues) {
  EXPECT_THAT(refusal(R"({"counts_per_rad": [1572, 0, 1572]})"), HasSubstr("counts_per_rad[1]: 0 is too small"));
  EXPECT_THAT(refusal(R"({"home_angle": 35})"), HasSubstr("home_angle: 35 is too large"));
  EXPECT_THAT(refusal(R"({"home_angle": [3, 3, 3]})"), HasSubstr("home_angle: the legs of this geometry cannot reach"));
  EXPECT_THAT(refusal(R"({"counts_per_n_m": -10000})"), HasSubstr("counts_per_n_m: -10000 is too small"));
  EXPECT_THAT(refusal(R"({"encoder_sign": [1, 0, 1]})"), HasSubstr("encoder_sign: a sign is 1 or -1"));
  EXPECT_THAT(refusal(R"({"motor_sign": 0.5})"), HasSubstr("motor_sign: a sign is 1 or -1"));
  EXPECT_THAT(refusal(R"({"motor_sign": 2})"), HasSubstr("motor_sign: 2 is too large"));
  EXPECT_THAT(refusal(R"({"max_motor_counts": 40000})"), HasSubstr("the maximum is 32767"));
  EXPECT_THAT(refusal(R"({"max_motor_counts": 0.5})"), HasSubstr("max_motor_counts"));
  EXPECT_THAT(refusal(R"({"flags": {"red": 3}})"), HasSubstr("red: 3 is not one bit"));
  EXPECT_THAT(refusal(R"({"flags": {"homing": 2}})"), HasSubstr("green: 2 is already the bit of another flag"));
  EXPECT_THAT(refusal(R"({"flags": {"red": 128}})"), HasSubstr("red: 128 is too large"));
  EXPECT_THAT(refusal(R"({"max_force": 0})"), HasSubstr("max_force: 0 is too small"));
  EXPECT_THAT(refusal(R"({"geometry": {"thigh": 60}})"), HasSubstr("my.json: geometry: thigh is 60 m"));
  EXPECT_THAT(refusal(R"({"geometry": {"azimuths": 1}})"),
              HasSubstr("geometry: azimuths: two legs are at the same place"));
  EXPECT_THAT(refusal(R"({"workspace": 0.08})"), HasSubstr("workspace: its corner (-0.08, -0.08, -0.08)"));
  EXPECT_THAT(refusal(R"({"origin": [0, 0, 0.15]})"), HasSubstr("out of the legs' reach"));
  EXPECT_THAT(refusal(R"({"geometry": {"shin": 0.02}})"), HasSubstr("home_angle: the legs of this geometry"));
}

}  // namespace
}  // namespace haptrace::test
