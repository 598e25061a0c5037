// The objects near the tool, found among many.
#include "scene/broad_phase.h"

#include "base/json_reader.h"
#include "scene/scene.h"
#include "scene/scene_file.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <random>

namespace haptrace {
namespace {

constexpr double kForever = std::numeric_limits<double>::infinity();

std::vector<std::uint32_t> meeting(const std::vector<Box>& boxes, const Box& space, std::vector<std::uint32_t> also) {
  for (std::uint32_t i = 0; i < boxes.size(); ++i)
    if ((boxes[i].min.array() <= space.max.array()).all() && (boxes[i].max.array() >= space.min.array()).all())
      also.push_back(i);
  std::sort(also.begin(), also.end());
  also.erase(std::unique(also.begin(), also.end()), also.end());
  return also;
}

TEST(BroadPhase, FindsWhatAComparisonOfAllBoxesFinds) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> side(-1, 1), size(0, 1);
  for (const std::size_t count : {0U, 1U, 24U, 25U, 300U, 2000U})
    for (const double spread : {1e-4, 0.2, 50.0}) {
      std::vector<Box> boxes;
      for (std::size_t i = 0; i < count; ++i) {
        const Vec3 at = spread * Vec3(side(random), side(random), side(random));
        // Some are large, some flat, some infinite.
        const double scale = i % 50 == 7 ? 2 : 0.02;
        const Vec3 half = spread * scale * Vec3(size(random), size(random), i % 9 == 0 ? 0 : size(random));
        boxes.push_back(i % 97 == 11 ? Box{Vec3::Constant(-kForever), Vec3(kForever, kForever, at.z())}
                                     : Box{at - half, at + half});
      }
      BroadPhase phase(boxes);
      for (int query = 0; query < 300; ++query) {
        const Vec3 at = 1.2 * spread * Vec3(side(random), side(random), side(random));
        const double reach = spread * (query % 10 == 0 ? 1.0 : 0.01) * size(random);
        const Box space{at - Vec3::Constant(reach), at + Vec3::Constant(reach)};
        std::vector<std::uint32_t> also;
        if (count > 3 && query % 3 == 0) also = {2, static_cast<std::uint32_t>(random() % count)};
        const auto found = phase.near(space, also);
        ASSERT_EQ(std::vector(found.begin(), found.end()), meeting(boxes, space, also)) << count << ' ' << spread;
      }
      const Box everywhere{Vec3::Constant(-1e300), Vec3::Constant(1e300)};
      EXPECT_EQ(phase.near(everywhere, {}).size(), count);
    }
}

TEST(ManyObjects, AnswerAsIfEachWasAskedAndKeepHoldingAToolOutsideTheirBoxes) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> side(-0.05, 0.05);
  std::string objects;
  std::vector<std::shared_ptr<Scene>> alone;
  for (int i = 0; i < 200; ++i) {
    const std::string object = fmt::format(
        R"({{"kind": "sphere", "name": "ball {}", "centre": [{}, {}, {}], "radius": {}, "stiffness": 500}})", i,
        side(random), side(random), side(random), 0.003 + 0.001 * (i % 7));
    objects += (i > 0 ? "," : "") + object;
    alone.push_back(read_scene(parse_json(R"({"objects": [)" + object + "]}", "test"), "test"));
  }
  const auto scene = read_scene(parse_json(R"({"objects": [)" + objects + "]}", "test"), "test");
  scene->prepare({});
  for (const auto& one : alone) one->prepare({});
  std::size_t several = 0;
  for (int tick = 0; tick < 5000; ++tick) {
    const double t = 1e-3 * tick;
    const Touch touch{0.04 * Vec3(std::sin(7 * t), std::sin(11 * t), std::cos(5 * t)), Vec3::Zero(), 1e-3};
    const SceneAnswer answer = scene->answer(touch);
    Vec3 force = Vec3::Zero();
    std::size_t touched = 0;
    for (const auto& one : alone) {
      const SceneAnswer own = one->answer(touch);
      force += own.force;
      touched += own.contacts[0].touched() ? 1 : 0;
    }
    ASSERT_LT((answer.force - force).norm(), 1e-12);
    const auto count = static_cast<std::size_t>(std::count_if(
        answer.contacts.begin(), answer.contacts.end(), [](const Contact& contact) { return contact.touched(); }));
    ASSERT_EQ(count, touched);
    several += touched > 1 ? 1 : 0;
  }
  EXPECT_GT(several, 20U) << "several objects at once";
}

}  // namespace
}  // namespace haptrace
