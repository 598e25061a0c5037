#include "formats/documents/device_frame.h"

#include "base/json_reader.h"
#include "control/rotation.h"
#include "tests/formats/support.h"

#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

DeviceFrame frame_of(const std::string& text) {
  const TempFolder folder;
  return load_device_frame(folder.write("frame.json", text));
}

TEST(DeviceFrame, ReadsAQuaternionOrAMatrix) {
  const Vec3 quarter(0, 0, std::numbers::pi / 2);
  for (const char* rotation :
       {"[0.7071067811865476, 0, 0, 0.7071067811865476]", "[0.7071, 0, 0, 0.7071]",
        "[[0, -1, 0], [1, 0, 0], [0, 0, 1]]", "[[0.0002, -1, 0], [1, 0.0002, 0], [0, 0, 1.0001]]"}) {
    const DeviceFrame frame = frame_of(fmt::format(R"({{"rotation": {}, "translation": [1, 2, -3]}})", rotation));
    EXPECT_LT((rotation_vector(frame.rotation) - quarter).norm(), 3e-4) << rotation;
    EXPECT_NEAR(frame.rotation.norm(), 1, 1e-15);
    EXPECT_EQ(frame.translation, Vec3(1, 2, -3));
  }
  EXPECT_EQ(frame_of(R"({"translation": [1, 0, 0]})").rotation.w(), 1);
  EXPECT_EQ(frame_of(R"({"rotation": [1, 0, 0, 0], "description": "desk"})").translation, Vec3::Zero());
}

TEST(DeviceFrame, ReadsWhatItWrites) {
  const DeviceFrame frame{.rotation = quaternion(Vec3(0.3, -1, 2)), .translation = Vec3(0.1, 0.2, 0.3)};
  const DeviceFrame again = frame_of(to_json(frame).dump());
  EXPECT_LT((again.rotation.coeffs() - frame.rotation.coeffs()).norm(), 1e-15);
  EXPECT_EQ(again.translation, frame.translation);
}

TEST(DeviceFrame, RejectsWhatIsNotARigidMotionAndSaysWhy) {
  const auto expect = [](const char* text, std::initializer_list<std::string> parts) {
    expect_error([&] { (void)frame_of(text); }, Error::Kind::input, parts);
  };
  expect(R"({"rotation": [1, 1, 0, 0]})", {"frame.json: rotation", "length is 1.41421", "w, x, y, z"});
  expect(R"({"rotation": [0, 0, 0, 0]})", {"length is 0"});
  expect(R"({"rotation": [[2, 0, 0], [0, 1, 0], [0, 0, 1]]})", {"rotation[0]", "length is 2", "does not scale"});
  expect(R"({"rotation": [[1, 0, 0], [0.6, 0.8, 0], [0, 0, 1]]})", {"rows 0 and 1", "0.6", "shear"});
  expect(R"({"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]})", {"mirrors", "-1", "right-handed"});
  expect(R"({"rotation": [[1, 0, 0], [0, 1, 0]]})", {"rotation", "three rows"});
  expect(R"({"rotation": [[1, 0], [0, 1, 0], [0, 0, 1]]})", {"rotation[0]", "expected 3 numbers"});
  expect(R"({"rotation": [1, 0, 0, "0"]})", {"expected 4 numbers"});
  expect(R"({"rotation": 1})", {"three rows"});
  expect(R"({"rotation": [1, 0, 0, 0], "translation": [1, 2]})", {"translation"});
  expect(R"({"translation": [1e9, 0, 0]})", {"translation", "maximum"});
  expect(R"({})", {"needs a rotation"});
  expect(R"({"rotation": [1, 0, 0, 0], "scale": 2})", {"scale"});
  expect_error([] { (void)load_device_frame("/nowhere/frame.json"); }, Error::Kind::input, {"/nowhere/frame.json"});
}

TEST(DeviceFrame, AgreesWithItsSchema) {
  const TempFolder folder;
  const std::vector<std::pair<std::string, bool>> frames{
      {R"({"rotation": [1, 0, 0, 0], "translation": [1, 2, 3]})", true},
      {R"({"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "description": "d", "$schema": "s"})", true},
      {R"({"translation": 0.5})", true},
      {R"({})", false},
      {R"({"rotation": [1, 0, 0]})", false},
      {R"({"rotation": [[1, 0, 0], [0, 1, 0]]})", false},
      {R"({"rotation": "x"})", false},
      {R"({"rotation": [2, 0, 0, 0]})", false},
      {R"({"translation": [1, 2]})", false},
      {R"({"translation": [2000, 0, 0]})", false},
      {R"({"translation": [0, 0, 0], "other": 1})", false}};
  std::string lines;
  for (const auto& [text, valid] : frames) {
    lines += text + "\n";
    bool read = true;
    try {
      (void)frame_of(text);
    } catch (const Error&) {
      read = false;
    }
    EXPECT_EQ(read, valid) << text;
  }
  const std::string file = folder.write("frames.jsonl", lines), answer = folder / "answer.txt";
  const std::string script = folder.write("check.py", R"(
import json, sys, jsonschema
validator = jsonschema.Draft7Validator(json.load(open(sys.argv[1])))
print("".join("1" if validator.is_valid(json.loads(line)) else "0" for line in open(sys.argv[2])))
)");
  const std::string command =
      fmt::format("{} {} {}/device_frame.schema.json {} > {}", HAPTRACE_PYTHON, script, HAPTRACE_FORMATS, file, answer);
  ASSERT_EQ(std::system(command.c_str()), 0);
  const std::string valid = read_bytes(answer);
  for (std::size_t i = 0; i < frames.size(); ++i) EXPECT_EQ(valid[i] == '1', frames[i].second) << frames[i].first;
}

}  // namespace
}  // namespace haptrace
