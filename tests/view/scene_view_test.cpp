// A virtual scene on the page: its message, its meshes and the columns of its contacts.
#include "base/file_hash.h"
#include "formats/recording/recording.h"
#include "player/record.h"
#include "scene/scene.h"
#include "scene/scene_file.h"
#include "tests/support/point_mass.h"
#include "tests/support/temp_folder.h"
#include "tests/view/page_client.h"
#include "view/live_view.h"
#include "view/recording_view.h"
#include "view/scene_messages.h"
#include "view/shown_scene.h"

#include <cmath>
#include <cstring>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using test::BinaryMessage;
using test::PageClient;
using test::PointMass;
using test::TempFolder;

constexpr const char* kTwo = R"({"objects": [
  {"kind": "sphere", "name": "ball", "radius": 0.03, "stiffness": 800},
  {"kind": "wall", "name": "floor", "point": [0, 0, -0.02], "normal": [0, 0, 1], "stiffness": 1000}]})";

TEST(ShownScene, HasAMeshOfEveryObjectWithinTheLimitsOfAPage) {
  const auto scene = read_scene(nlohmann::json::parse(kTwo), "test");
  const std::vector<ShownObject> objects = shown_objects(*scene);
  ASSERT_EQ(objects.size(), 2U);
  EXPECT_EQ(objects[0].name, "ball");
  EXPECT_EQ(objects[1].kind, "wall");
  for (const Vec3& vertex : objects[0].mesh.vertices) EXPECT_NEAR(vertex.norm(), 0.03, 1e-9);
  ASSERT_FALSE(objects[1].mesh.triangles.empty());
  for (const Vec3& vertex : objects[1].mesh.vertices) {
    EXPECT_NEAR(vertex.z(), -0.02, 1e-9);
    EXPECT_LT(vertex.norm(), 0.2) << "cut off around the ball";
  }
}

TEST(ShownScene, OfARecordingFindsItsFilesBesideItOrInTheFolderOfItsScene) {
  const TempFolder home, copy;
  const std::string cup = "v 0 0 0\nv 0.02 0 0\nv 0 0.02 0\nv 0 0 0.02\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";
  const std::string hash = file_hash(home.write("cup.obj", cup));
  RecordedScene scene{.text = R"({"objects": [{"kind": "mesh", "name": "cup", "file": "cup.obj", "stiffness": 500}]})",
                      .objects = {"cup"},
                      .files = {{"cup.obj", hash}},
                      .folder = home.path()};
  const auto has_mesh = [&] {
    const std::vector<ShownObject> objects = shown_objects(scene, copy / "a.h5");
    EXPECT_EQ(objects.size(), 1U);
    EXPECT_EQ(objects.at(0).name, "cup");
    return !objects.at(0).mesh.triangles.empty();
  };
  EXPECT_TRUE(has_mesh()) << "in the folder of the scene";
  scene.folder = "/nowhere";
  EXPECT_FALSE(has_mesh());
  (void)copy.write("cup.obj", cup);
  EXPECT_TRUE(has_mesh()) << "copied along with the recording";
  (void)copy.write("cup.obj", cup + "# changed\n");
  EXPECT_FALSE(has_mesh());
  scene.folder = "";
  scene.files = {{home / "cup.obj", hash}};
  EXPECT_TRUE(has_mesh()) << "an early recording has the whole path";
}

TEST(ShownScene, ThinsAMeshThatIsTooLarge) {
  TriangleMesh mesh;
  for (int j = 0; j <= 300; ++j)
    for (int i = 0; i <= 300; ++i) mesh.vertices.emplace_back(1e-3 * i, 1e-3 * j, 0);
  for (std::uint32_t j = 0; j < 300; ++j)
    for (std::uint32_t i = 0; i < 300; ++i) {
      const std::uint32_t a = j * 301 + i;
      mesh.triangles.push_back({a, a + 1, a + 302});
      mesh.triangles.push_back({a, a + 302, a + 301});
    }
  const TriangleMesh thin = thinned(mesh, 2000, 4000);
  EXPECT_LE(thin.vertices.size(), 2000U);
  EXPECT_LE(thin.triangles.size(), 4000U);
  EXPECT_GT(thin.triangles.size(), 500U);
  for (const auto& t : thin.triangles)
    for (const std::uint32_t corner : t) ASSERT_LT(corner, thin.vertices.size());
}

TEST(SceneOnAPage, OfARecordingHasItsObjectsItsMeshesAndItsContacts) {
  const TempFolder folder;
  PointMass device;
  device.place({0, 0, 0.0305});
  device.throw_at({0, 0, -0.2});
  RecordOptions options{.duration = 0.3};
  options.session.touch.scene = read_scene(nlohmann::json::parse(kTwo), "test");
  options.session.recording = SessionOptions::Recording{.file = folder / "touched.h5"};
  (void)record(device, options, StopRequest{});

  RecordingView view({folder / "touched.h5"}, {});
  const std::string address = view.address();
  PageClient page(static_cast<std::uint16_t>(std::stoi(address.substr(address.rfind(':') + 1))));
  page.hello(address.substr(address.find('#') + 1));
  const nlohmann::json recording = page.wait_for("recording");
  std::vector<std::string> names;
  for (const auto& column : recording["columns"]) names.push_back(column["name"]);
  EXPECT_THAT(names, testing::IsSupersetOf({"proxy_x", "proxy_z", "contact", "normal_z"}));
  const nlohmann::json scene = page.wait_for("scene");
  ASSERT_EQ(scene["objects"].size(), 2U);
  EXPECT_EQ(scene["objects"][0]["name"], "ball");
  for (std::uint32_t i = 0; i < 2; ++i) {
    const BinaryMessage mesh = page.wait_for_binary(5);
    EXPECT_EQ(mesh.request, scene["id"]);
    EXPECT_EQ(mesh.rows, scene["objects"][i]["mesh"]["vertices"]);
    std::uint32_t object = 0, triangles = 0;
    std::memcpy(&object, mesh.body.data(), 4);
    std::memcpy(&triangles, mesh.body.data() + 4, 4);
    EXPECT_EQ(object, i);
    EXPECT_EQ(triangles, scene["objects"][i]["mesh"]["triangles"]);
    EXPECT_EQ(mesh.body.size(), 8 + 12 * (mesh.rows + triangles));
  }
  page.send({{"type", "rows"}, {"id", 9}, {"t0", 0}, {"t1", 1}});
  const BinaryMessage rows = page.wait_for_binary(1);
  const RecordingReader reader(folder / "touched.h5");
  const auto samples = reader.read(0, reader.rows());
  ASSERT_EQ(rows.rows, samples.size());
  const auto index = [&](const char* name) {
    return static_cast<std::size_t>(std::find(names.begin(), names.end(), name) - names.begin()) + 1;
  };
  const std::vector<float> contact = rows.plane(index("contact")), proxy = rows.plane(index("proxy_z"));
  int touched = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (samples[i].position.z() < 0.03) {
      ++touched;
      EXPECT_EQ(contact[i], 0);
      EXPECT_NEAR(proxy[i], 0.03, 1e-6);
    } else {
      EXPECT_TRUE(std::isnan(contact[i]) && std::isnan(proxy[i]));
    }
  }
  EXPECT_GT(touched, 10);
}

}  // namespace
}  // namespace haptrace
