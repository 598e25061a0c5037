#include "devices/haply/inverse3.h"

#include "base/json_reader.h"
#include "devices/haply/emulated_inverse.h"
#include "tests/devices/device_laws.h"
#include "tests/devices/support.h"
#include "tests/support/real_time.h"

#include <filesystem>
#include <gmock/gmock.h>
#include <random>
#include <thread>

namespace haptrace::test {

std::vector<Listed> listed_devices() {
  return {{"inverse3", [] { return open_device("inverse3:emulated=true"); }, true, true, false},
          {"inverse3_held", [] { return open_device("inverse3:emulated=true,hand=firm,seed=3"); }, true, false, false}};
}

namespace {

using nlohmann::json;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using namespace std::chrono_literals;

const char* const kInventory = R"({"session_id": 7,
  "inverse3": [{"device_id": "049D",
    "config": {"type": "inverse3x", "handedness": "left", "preset": "defaults", "basis": {"permutation": "XYZ"},
               "mount": {"position": {"x": 0, "y": 0, "z": 0}, "rotation": {"w": 1}, "scale": {"x": 1, "y": 1, "z": 1}}},
    "state": {"cursor_position": {"x": 0.01, "y": -0.12, "z": 0.15}, "cursor_velocity": {"x": 0.5}},
    "status": {"calibrated": true, "ready": true, "power_supply": true, "in_use": false}}],
  "wireless_verse_grip": [{"device_id": "61576",
    "state": {"orientation": {"w": 0.8, "x": 0.6}, "buttons": {"a": true, "c": true}, "hall": 12}}]})";

InverseServiceView view_of(const std::string& message) {
  InverseServiceView view;
  view.take(message);
  return view;
}

/// Returns kInventory with the element at `pointer` replaced by `value`.
std::string inventory_with(const char* pointer, const json& value) {
  json inventory = json::parse(kInventory);
  inventory[json::json_pointer(pointer)] = value;
  return inventory.dump();
}

// ---- messages ----

TEST(InverseMessages, ContainThePositionAndTheStatusOfTheArm) {
  const InverseServiceView view = view_of(kInventory);
  EXPECT_THAT(view.listed(), ElementsAre("049D"));
  const InverseArm arm = view.arm("049D");
  EXPECT_EQ(arm.type, "inverse3x");
  EXPECT_EQ(arm.position, Vec3(0.01, -0.12, 0.15));
  EXPECT_EQ(arm.velocity, Vec3(0.5, 0, 0));
  EXPECT_TRUE(arm.powered && arm.calibrated && arm.ready && !arm.in_use);
  EXPECT_THAT(arm.displaced, IsEmpty());
  EXPECT_THAT(obstacle_of(arm, false).what, IsEmpty());
  ASSERT_TRUE(view.grip());
  EXPECT_EQ(view.grip()->buttons, 5U);
  EXPECT_DOUBLE_EQ(view.grip()->orientation.x(), 0.6);
}

TEST(InverseMessages, KeepValuesThatALaterMessageOmitsOrSetsToNull) {
  InverseServiceView view = view_of(kInventory);
  view.take(R"({"inverse3": [{"device_id": "049D", "state": {"cursor_position": {"x": 0.02, "z": null}}}]})");
  EXPECT_EQ(view.arm("049D").position, Vec3(0.02, -0.12, 0.15));
  EXPECT_TRUE(view.arm("049D").calibrated);
  view.take(R"({"inverse3": [{"device_id": "049D", "state": null, "status": {"ready": false}}]})");
  EXPECT_EQ(view.arm("049D").position, Vec3(0.02, -0.12, 0.15));
  EXPECT_FALSE(view.arm("049D").ready);
  EXPECT_EQ(view.grip()->buttons, 5U);
  view.take(R"({"inverse3": []})");
  EXPECT_THAT(view.listed(), IsEmpty());
}

TEST(InverseMessages, TreatMissingValuesAsFalseAndZero) {
  const InverseArm arm = view_of(R"({"inverse3": [{"device_id": "1"}]})").arm("1");
  EXPECT_EQ(arm.position, Vec3::Zero());
  EXPECT_FALSE(arm.velocity || arm.powered || arm.calibrated || arm.ready || arm.in_use);
  EXPECT_FALSE(view_of("{}").grip());
}

TEST(InverseMessages, ContainBothGripsAndPreferTheWirelessOne) {
  InverseServiceView view = view_of(R"({"verse_grip": [{"device_id": "1", "state": {"buttons": {"b": true}}}]})");
  EXPECT_EQ(view.grip()->buttons, 2U);
  view.take(kInventory);
  EXPECT_EQ(view.grip()->buttons, 5U);
  view.take(R"({"wireless_verse_grip": [{"device_id": "61576", "state": {"orientation": {"w": 0.9, "x": 0}}}]})");
  EXPECT_DOUBLE_EQ(view.grip()->orientation.norm(), 1);
}

TEST(InverseMessages, AreRejectedUnlessTheyHaveTheFormOfTheService) {
  for (const char* text : {"", "{]", "[]", "3", "\"hello\"", R"({"inverse3": {}})", R"({"inverse3": [1]})",
                           R"({"inverse3": [{}]})", R"({"inverse3": [{"device_id": 3}]})", "{\"a\": 1e999}"})
    EXPECT_THAT(error_of([&] { view_of(text); }, Error::Kind::device), HasSubstr("Inverse Service")) << text;
  EXPECT_NO_THROW(view_of("{}"));

  for (const char* pointer : {"/inverse3/0/state", "/inverse3/0/state/cursor_position", "/inverse3/0/status/ready",
                              "/inverse3/0/state/cursor_position/x", "/inverse3/0/config/basis/permutation"}) {
    const InverseServiceView view = view_of(inventory_with(pointer, json::array({1})));
    EXPECT_THAT(error_of([&] { (void)view.arm("049D"); }, Error::Kind::device), HasSubstr("[1]")) << pointer;
  }
  const InverseServiceView view =
      view_of(inventory_with("/wireless_verse_grip/0/state/orientation", {{"w", 0}, {"x", 0}}));
  EXPECT_THAT(error_of([&] { (void)view.grip(); }, Error::Kind::device), HasSubstr("orientation"));
}

TEST(InverseMessages, GiveAStateOrAnErrorHoweverTheyAreDamaged) {
  std::mt19937 random(5);
  const std::string whole = kInventory;
  for (int round = 0; round < 1000; ++round) {
    std::string text = whole;
    for (auto n = 1 + random() % 4; n > 0; --n) {
      const auto at = random() % text.size();
      switch (random() % 3) {
        case 0:
          text[at] = static_cast<char>(random() % 256);
          break;
        case 1:
          text.erase(at, random() % 20);
          break;
        default:
          text.insert(at, text.substr(random() % text.size(), random() % 20));
      }
    }
    InverseServiceView view = view_of(kInventory);
    try {
      view.take(text);
      for (const std::string& id : view.listed()) EXPECT_TRUE(is_finite(view.arm(id).position));
      (void)view.grip();
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), Error::Kind::device) << error.what();
    }
  }
}

TEST(InverseMessages, ShowTheSettingsThatMoveTheServicesAxes) {
  const json turned{{"w", 0.0}, {"x", 1.0}, {"y", 0.0}, {"z", 0.0}};
  const std::vector<std::tuple<const char*, json, const char*>> cases{
      {"/inverse3/0/config/basis/permutation", "XZY", "basis XZY"},
      {"/inverse3/0/config/mount/rotation", turned, "mount rotation"},
      {"/inverse3/0/config/mount/transform", {{"rotation", turned}}, "mount rotation"},
      {"/inverse3/0/config/mount/position/z", 0.1, "mount position"},
      {"/inverse3/0/config/mount/scale/y", 2, "mount scale"},
      {"/inverse3/0/state/transform", {{"scale", {{"x", 3}}}}, "transform scale"},
  };
  for (const auto& [pointer, value, displaced] : cases)
    EXPECT_THAT(view_of(inventory_with(pointer, value)).arm("049D").displaced, ElementsAre(displaced));
}

TEST(InverseMessages, ShowTheSettingThatChangedTheMeaningOfAPosition) {
  const InverseArm before = view_of(kInventory).arm("049D");
  EXPECT_EQ(changed_setting(before, before), "");
  for (const auto& [pointer, value, what] : std::vector<std::tuple<const char*, json, const char*>>{
           {"/inverse3/0/config/basis/permutation", "-XYZ", "basis +X+Y+Z became -X+Y+Z"},
           {"/inverse3/0/config/mount/rotation", {{"w", 0.0}, {"z", 1.0}}, "mount rotation changed"},
           {"/inverse3/0/config/mount/scale/y", 2, "mount scale changed"},
           {"/inverse3/0/state/transform", {{"position", {{"x", 0.01}}}}, "transform position changed"},
           {"/inverse3/0/config/handedness", "right", "handedness left became right"},
           {"/inverse3/0/config/preset", "custom", "preset defaults became custom"}})
    EXPECT_EQ(changed_setting(before, view_of(inventory_with(pointer, value)).arm("049D")), what);
  EXPECT_EQ(
      changed_setting(before, view_of(inventory_with("/inverse3/0/config/basis/permutation", "+X+Y+Z")).arm("049D")),
      "")
      << "the same in other letters";
  EXPECT_EQ(changed_setting(before, view_of(inventory_with("/inverse3/0/config/mount/rotation/w", -1.0)).arm("049D")),
            "")
      << "the same rotation";
  // Filters count as changed only if the inventory has stated them before.
  const InverseArm filtered = view_of(inventory_with("/inverse3/0/config/filters", {{"hz", 20}})).arm("049D");
  EXPECT_EQ(changed_setting(before, filtered), "");
  InverseArm completed = before;
  completed.complete(filtered);
  EXPECT_EQ(changed_setting(completed, filtered), "");
  EXPECT_NE(changed_setting(completed, view_of(inventory_with("/inverse3/0/config/filters", {{"hz", 30}})).arm("049D")),
            "");
}

TEST(InverseMessages, ShowTheKeyOfAForce) {
  EXPECT_EQ(view_of(kInventory).force_key(), InverseForceKey::vector);
  EXPECT_EQ(view_of(R"({"inverse3": [{"device_id": "1", "config": {"handedness": "left"}}]})").force_key(),
            InverseForceKey::values);
}

TEST(InverseMessages, RequestAForceAndIdentifyTheClientOnce) {
  const json first = json::parse(inverse_command("049D", Vec3(1, -2, 0.5), InverseForceKey::vector, true));
  EXPECT_EQ(first["session"]["configure"]["profile"]["name"], "haptrace");
  const json asked{{"device_id", "049D"},
                   {"commands", {{"set_cursor_force", {{"vector", {{"x", 1.0}, {"y", -2.0}, {"z", 0.5}}}}}}}};
  EXPECT_EQ(first["inverse3"], json::array({asked}));
  const json later = json::parse(inverse_command("\"", Vec3(1, -2, 0.5), InverseForceKey::values, false));
  EXPECT_FALSE(later.contains("session"));
  EXPECT_EQ(later["inverse3"][0]["device_id"], "\"");
  EXPECT_EQ(later["inverse3"][0]["commands"]["set_cursor_force"]["values"]["y"], -2.0);
}

// ---- calibration ----

TEST(Inverse3Calibration, HasTheAxesOfTheOtherDevices) {
  const Inverse3Calibration calibration;
  EXPECT_EQ(calibration.vector(Vec3::UnitX()), Vec3::UnitX()) << "right";
  EXPECT_EQ(calibration.vector(Vec3::UnitY()), -Vec3::UnitZ()) << "forward is away from the user";
  EXPECT_EQ(calibration.vector(Vec3::UnitZ()), Vec3::UnitY()) << "up";
  EXPECT_EQ(calibration.position(calibration.origin), Vec3::Zero());
}

TEST(Inverse3Calibration, DoesTheSameWorkInEveryFrame) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  const auto any = [&] { return Vec3(normal(random), normal(random), normal(random)); };
  for (const char* axes : {"XYZ", "XZ-Y", "YZX", "-X-YZ", "-Z-Y-X"}) {
    Inverse3Calibration calibration;
    calibration.axes = read_inverse3_axes(axes, "test");
    const Vec3 force = any(), velocity = any(), place = any(), arm = any();
    EXPECT_NEAR(calibration.command(force).dot(velocity), force.dot(calibration.vector(velocity)), 1e-12) << axes;
    // The position of a point on a tool does not depend on the order of the conversions.
    const Quat turn = Quat(Eigen::AngleAxisd(1, any().normalized()));
    const Vec3 told = calibration.position(place + turn * arm),
               ours = calibration.position(place) + calibration.orientation(turn) * arm;
    EXPECT_LT((told - ours).norm(), 1e-12) << axes;
  }
}

TEST(Inverse3Calibration, RequestsNoMoreThanTheLargestForceOfTheArm) {
  const Inverse3Calibration calibration;
  const Vec3 asked = calibration.command(Vec3(300, 0, 400));
  EXPECT_NEAR(asked.norm(), calibration.max_force, 1e-12);
  EXPECT_LT((calibration.vector(asked) - Vec3(6, 0, 8)).norm(), 1e-12);
}

TEST(Inverse3Calibration, RejectsInvalidAxes) {
  for (const char* text : {"", "XY", "XYZX", "XXY", "XZY", "X-YZ", "xyz", "abc", "X,Y,Z"})
    EXPECT_THAT(error_of([&] { (void)read_inverse3_axes(text, "my.json: axes"); }),
                AllOf(HasSubstr("my.json: axes"), HasSubstr("XZ-Y")))
        << text;
}

TEST(Inverse3Calibration, ReadsTheSampleAsItsDefaults) {
  const Inverse3Calibration calibration = read_inverse3_calibration(load_json(SAMPLE_INVERSE3), "sample"), plain;
  EXPECT_EQ(calibration.axes, plain.axes);
  EXPECT_EQ(calibration.origin, plain.origin);
  EXPECT_EQ(calibration.workspace, plain.workspace);
  EXPECT_EQ(calibration.max_force, plain.max_force);
  EXPECT_EQ(calibration.max_continuous_force, plain.max_continuous_force);
  EXPECT_THAT(error_of([] { (void)read_inverse3_calibration({{"orgin", 1}}, "my.json"); }), HasSubstr("'origin'"));
}

// ---- the device and its service ----

/// Waits about 5 s at most until `condition` holds; if it does not, the test's next expectation fails.
template <class Condition>
void wait_until(Condition condition) {
  for (int k = 0; k < 5000 && !condition(); ++k) std::this_thread::sleep_for(1ms);
}

class Inverse3 : public testing::Test {
 protected:
  Inverse3() { in_real_time(); }

  std::optional<EmulatedInverseService> service_;

  void serve(const EmulatedInverseOptions& options = {}) {
    service_.emplace(open_live_plant(DeviceSpec::parse("inverse3:emulated=true"), "inverse3"), options);
  }
  [[nodiscard]] std::unique_ptr<Device> open(const std::string& more = "") {
    if (!service_) serve();
    return open_device("inverse3:url=" + service_->url() + more);
  }
  std::string refusal(const std::string& more = "") {
    if (!service_) serve();
    return open_error("inverse3:url=" + service_->url() + more, Error::Kind::device);
  }
  /// Exchanges until the motors have this force or the device is lost.
  void push(Device& device, const Vec3& force) {
    DeviceState state;
    bool pushed = false;
    wait_until([&] {
      const bool ok = device.exchange({force, Vec3::Zero()}, 1e-3, state) == Device::Status::ok;
      return (pushed = service_->force() == force) || !ok;
    });
    EXPECT_TRUE(pushed) << device.lost_reason();
  }
};

TEST_F(Inverse3, PushesInTheCommandedDirectionAndIdentifiesItself) {
  const auto device = open();
  EXPECT_EQ(device->info().serial, "049D");
  EXPECT_EQ(device->info().model, "Haply Inverse3");
  EXPECT_TRUE(device->info().measures_velocity);
  EXPECT_FALSE(device->info().measures_orientation);
  for (const Vec3& force : {Vec3(2, 0, 0), Vec3(0, 2, 0), Vec3(0, 0, -2)}) push(*device, force);
  EXPECT_EQ(service_->client(), "haptrace");
}

TEST_F(Inverse3, FindsTheKeyOfEveryVersion) {
  for (const InverseForceKey key : {InverseForceKey::vector, InverseForceKey::values})
    for (const bool tells : {true, false}) {
      serve({.force_key = key, .tells_version = tells});
      push(*open(), Vec3(1, 0, 0));
    }
}

TEST_F(Inverse3, UsesTheConfiguredKey) {
  serve({.force_key = InverseForceKey::values});
  EXPECT_THAT(refusal(",force_key=vector"), AllOf(HasSubstr("refuses"), HasSubstr("try force_key=values")));
  push(*open(",force_key=values"), Vec3(1, 0, 0));
}

TEST_F(Inverse3, FollowsAnswersThatOmitUnchangedValues) {
  const auto device = open();
  service_->inject(InverseFault::partial);
  Vec3 last = Vec3::Zero();
  for (int k = 0; k < 100; ++k) {
    last = exchange(*device, Vec3(1, 0, 0), 1e-3).position;
    std::this_thread::sleep_for(1ms);
  }
  EXPECT_GT(last.x(), 1e-3);
  EXPECT_LT(last.tail<2>().norm(), 1e-9);
}

TEST_F(Inverse3, ReportsTheGrip) {
  serve({.grip = true});
  const auto device = open();
  EXPECT_TRUE(device->info().measures_orientation);
  // The grip is upright in the service's frame, so its axes are those of the service.
  const DeviceState state = exchange(*device, Vec3::Zero(), 1e-3);
  EXPECT_LT((state.orientation * Vec3::UnitZ() - Vec3::UnitY()).norm(), 1e-12);
  EXPECT_EQ(state.buttons, 0U);
  wait_until([&] { return exchange(*device, Vec3(3, 0, 0), 1e-3).buttons == 1; });
  EXPECT_EQ(exchange(*device, Vec3(3, 0, 0), 1e-3).buttons, 1U);
}

TEST_F(Inverse3, LetsGoWhenItIsClosed) {
  auto device = open();
  push(*device, Vec3(0, 3, 0));
  device->close();
  EXPECT_EQ(service_->asked(), Vec3::Zero()) << "was told so, before its patience ended";
  EXPECT_EQ(service_->force(), Vec3::Zero());
  wait_until([&] { return service_->sessions() == 0; });
  EXPECT_EQ(service_->sessions(), 0);
}

TEST_F(Inverse3, SendsOneForceForEveryAnswerButHoldsNoZeroBack) {
  serve();
  const auto driver = open_inverse3_driver({.url = service_->url(), .force_key = {}, .calibration = {}});
  DeviceState state;
  for (int k = 1; k <= 20; ++k) {
    while (!driver->round({Vec3(1, 0, 0), Vec3::Zero()}, state)) {
    }
    EXPECT_EQ(service_->commands(), k);
  }
  service_->inject(InverseFault::silent);
  EXPECT_FALSE(driver->round({Vec3(2, 0, 0), Vec3::Zero()}, state));
  wait_until([&] { return service_->asked() == Vec3(2, 0, 0); });
  EXPECT_FALSE(driver->round({Vec3(3, 0, 0), Vec3::Zero()}, state));
  EXPECT_EQ(service_->asked(), Vec3(2, 0, 0)) << "no third before the second was answered";
  EXPECT_FALSE(driver->round({Vec3::Zero(), Vec3::Zero()}, state));
  wait_until([&] { return service_->asked() == Vec3::Zero(); });
  EXPECT_EQ(service_->asked(), Vec3::Zero());
}

TEST_F(Inverse3, IsLostWithoutForceWhenItsServiceReportsASafetyEvent) {
  const auto event = [](const char* type, const char* level, const char* id) {
    return json{{"name", "device-safety-triggered"},
                {"category", "device"},
                {"level", level},
                {"data", {{"device_family", "inverse"}, {"device_id", id}, {"safety_type", type}}},
                {"message", "for people"}}
        .dump();
  };
  for (const auto& [type, level] : {std::pair{"ebrake_triggered", "error"},
                                    {"stall_detected", "warning"},
                                    {"stability_ceiling", "warning"},
                                    {"fod_stage_changed", "warning"}}) {
    serve();
    const auto device = open(",events=" + service_->events_url());
    EXPECT_THAT(device->info().notes, IsEmpty());
    push(*device, Vec3(0, 0, 4));
    wait_until([&] { return service_->listeners() == 1; });
    // Events of another arm, harmless events and malformed messages do not end the session.
    for (const std::string& harmless : {event(type, level, "0500"), event("ebrake_released", "notice", "049D"),
                                        event("fod_stage_changed", "info", "049D"), std::string("{]"),
                                        std::string("[1]"), std::string(R"({"name": 1, "data": null})")})
      service_->report(harmless);
    for (int k = 0; k < 50; ++k) {
      exchange(*device, Vec3(0, 0, 4), 1e-3);
      std::this_thread::sleep_for(1ms);
    }
    service_->report(event(type, level, "049D"));
    DeviceState state;
    wait_until([&] {
      std::this_thread::sleep_for(1ms);
      return device->exchange({Vec3(0, 0, 4), Vec3::Zero()}, 1e-3, state) == Device::Status::lost;
    });
    EXPECT_THAT(device->lost_reason(), AllOf(HasSubstr(type), HasSubstr("for people"), HasSubstr("emergency brake")));
    wait_until([&] { return service_->sessions() == 0; });
    EXPECT_EQ(service_->asked(), Vec3::Zero()) << type;
  }
}

TEST_F(Inverse3, NotesThatAServiceWithoutAnEventChannelReportsNoSafetyEvents) {
  serve();
  EXPECT_THAT(open(",events=ws://127.0.0.1:1")->info().notes, ElementsAre(HasSubstr("no event channel")));
  EXPECT_THAT(open(",events=off")->info().notes, IsEmpty());
  EXPECT_THAT(open_error("inverse3:url=" + service_->url() + ",events=ws://192.0.2.1:10020"), HasSubstr("remote=true"));
}

struct FaultCase {
  InverseFault fault;
  const char* reason;
  const char* remedy;
  bool hears = true;  ///< the service still receives commands after the fault
};

TEST_F(Inverse3, IsLostWithoutForceWhenItsServiceFails) {
  for (const FaultCase& c : {FaultCase{InverseFault::silent, "not answer any more", "systemctl restart"},
                             {InverseFault::closes, "closed the connection", "Haply Hub", false},
                             {InverseFault::garbage, "not Haply's Inverse Service", "url"},
                             {InverseFault::unpowered, "no power supply", "plug its power supply in"},
                             {InverseFault::uncalibrated, "not calibrated", "inkwell"},
                             {InverseFault::not_ready, "not ready", "wait"},
                             {InverseFault::unplugged, "no longer lists Inverse3 049D", "cable"},
                             {InverseFault::mirrored, "basis +X+Y+Z became -X+Y+Z", "preset 'defaults'"},
                             {InverseFault::moved, "mount position changed", "preset 'defaults'"},
                             {InverseFault::filtered, "filters", "preset 'defaults'"}}) {
    serve();
    const auto device = open();
    push(*device, Vec3(0, 0, 4));
    service_->inject(c.fault);
    DeviceState state;
    wait_until([&] {
      std::this_thread::sleep_for(1ms);
      return device->exchange({Vec3(0, 0, 4), Vec3::Zero()}, 1e-3, state) == Device::Status::lost;
    });
    EXPECT_THAT(device->lost_reason(), AllOf(HasSubstr(c.reason), HasSubstr(c.remedy)));
    wait_until([&] { return service_->sessions() == 0; });
    EXPECT_EQ(service_->sessions(), 0) << c.reason;
    EXPECT_EQ(service_->force(), Vec3::Zero()) << c.reason;
    if (c.hears) {
      EXPECT_EQ(service_->asked(), Vec3::Zero()) << c.reason;
    }
  }
}

TEST_F(Inverse3, IsNotOpenedWhenItCannotBeUsed) {
  for (const FaultCase& c : {FaultCase{InverseFault::mute, "not an Inverse Service", "systemctl restart"},
                             {InverseFault::silent, "does not answer", "systemctl restart"},
                             {InverseFault::closes, "closed the connection", "systemctl start"},
                             {InverseFault::garbage, "not Haply's Inverse Service", "url"},
                             {InverseFault::unpowered, "no power supply", "plug its power supply in"},
                             {InverseFault::uncalibrated, "not calibrated", "inkwell"},
                             {InverseFault::not_ready, "not ready", "wait"},
                             {InverseFault::in_use, "another program uses it", "close that program"},
                             {InverseFault::unplugged, "lists no Inverse3", "cable"}}) {
    serve();
    service_->inject(c.fault);
    EXPECT_THAT(refusal(), AllOf(HasSubstr(c.reason), HasSubstr(c.remedy)));
    EXPECT_EQ(service_->asked(), Vec3::Zero()) << c.reason;
  }
}

TEST_F(Inverse3, IsNotOpenedWithoutAService) {
  serve();
  const std::string url = service_->url();
  service_.reset();
  EXPECT_THAT(open_error("inverse3:url=" + url, Error::Kind::device),
              AllOf(HasSubstr("no Inverse Service at " + url), HasSubstr("refused"), HasSubstr("systemctl start")));
}

TEST_F(Inverse3, RequiresAChoiceBetweenSeveralDevices) {
  serve({.second_device_id = "0500"});
  EXPECT_THAT(refusal(), AllOf(HasSubstr("049D, 0500"), HasSubstr("device_id=")));
  EXPECT_THAT(refusal(",device_id=9999"), AllOf(HasSubstr("'9999'"), HasSubstr("049D, 0500")));
  EXPECT_EQ(open(",device_id=049D")->info().serial, "049D");
}

TEST_F(Inverse3, IsNotOpenedWithAxesOfAnotherProgram) {
  serve({.basis = "XZY"});
  EXPECT_THAT(refusal(), AllOf(HasSubstr("basis XZY"), HasSubstr("calibration=FILE")));
  EXPECT_NO_THROW((void)open(",calibration=" SAMPLE_INVERSE3));
}

TEST_F(Inverse3, RejectsUrlsOfOtherMachinesAndUnreadableOptions) {
  for (const auto& [url, why] : {std::pair{"http://localhost", "ws://"},
                                 {"ws://haply.example:10001", "numeric address"},
                                 {"ws://192.0.2.1:10001", "remote=true"},
                                 {"ws://localhost:0", "port"},
                                 {"ws://localhost:99999", "port"},
                                 {"ws://[::1", "numeric address"},
                                 {"ws://", "numeric address"}})
    EXPECT_THAT(open_error(std::string("inverse3:url=") + url), HasSubstr(why)) << url;
  EXPECT_THAT(open_error("inverse3:remote=yes"), HasSubstr("remote"));
  EXPECT_THAT(open_error("inverse3:force_key=force"), HasSubstr("vector or values"));
  EXPECT_THAT(open_error("inverse3:hand=relaxed"), HasSubstr("emulated=true"));
  EXPECT_THAT(open_error("inverse3:id=049D"), HasSubstr("device_id"));
}

TEST_F(Inverse3, IsFoundWithTheObstacleToItsUse) {
  serve();
  std::vector<FoundDevice> found = find_inverse3(service_->url());
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].spec, "inverse3");
  EXPECT_EQ(found[0].serial, "049D");
  EXPECT_EQ(found[0].where, service_->url());
  EXPECT_THAT(found[0].obstacle + found[0].remedy, IsEmpty());
  EXPECT_EQ(service_->commands(), 0) << "looking asks for nothing";

  service_->inject(InverseFault::uncalibrated);
  EXPECT_THAT(find_inverse3(service_->url())[0].obstacle, HasSubstr("not calibrated"));
  service_->inject(InverseFault::unplugged);
  EXPECT_THAT(find_inverse3(service_->url())[0].obstacle, HasSubstr("lists no Inverse3"));
  service_->inject(InverseFault::mute);
  EXPECT_THAT(find_inverse3(service_->url()), IsEmpty());

  serve({.second_device_id = "0500"});
  found = find_inverse3(service_->url());
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[1].spec, "inverse3:device_id=0500");
  const std::string url = service_->url();
  service_.reset();
  EXPECT_THAT(find_inverse3(url), IsEmpty());
}

std::ptrdiff_t entries_of(const char* folder) {
  return std::distance(std::filesystem::directory_iterator(folder), std::filesystem::directory_iterator());
}

TEST_F(Inverse3, LeavesNothingBehindHoweverOftenItIsOpened) {
  (void)open();
  const auto count = [] { return std::pair(entries_of("/proc/self/fd"), entries_of("/proc/self/task")); };
  wait_until([&] { return service_->sessions() == 0; });
  const auto before = count();
  for (int k = 0; k < 200; ++k) {
    const auto device = open();
    exchange(*device, Vec3(1, 0, 0), 1e-3);
  }
  for (int k = 0; k < 20; ++k) (void)open_device("inverse3:emulated=true");
  // A joined thread may remain visible for a moment.
  wait_until([&] { return service_->sessions() == 0 && count() == before; });
  EXPECT_EQ(count(), before);
  EXPECT_EQ(service_->asked(), Vec3::Zero());
}

}  // namespace
}  // namespace haptrace::test
