#include "devices/device_spec.h"

#include "tests/devices/support.h"

#include <gmock/gmock.h>

namespace haptrace::test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::Pair;

std::string refusal(const std::string& text) {
  return error_of([&] { (void)DeviceSpec::parse(text); });
}

TEST(DeviceSpec, MayBeANameAlone) {
  const DeviceSpec spec = DeviceSpec::parse("sim");
  EXPECT_EQ(spec.text, "sim");
  EXPECT_EQ(spec.name, "sim");
  EXPECT_TRUE(spec.options.empty());
}

TEST(DeviceSpec, TakesOptionsApart) {
  const DeviceSpec spec = DeviceSpec::parse("sim:preset=omega3,hand=relaxed,seed=7");
  EXPECT_EQ(spec.name, "sim");
  EXPECT_THAT(spec.options, ElementsAre(Pair("hand", "relaxed"), Pair("preset", "omega3"), Pair("seed", "7")));
}

TEST(DeviceSpec, KeepsColonsAndEqualsSignsOfAValue) {
  EXPECT_EQ(DeviceSpec::parse("replay:file=C:/a=b.h5").options.at("file"), "C:/a=b.h5");
}

TEST(DeviceSpec, GivesTheRestOfTheTextToOptions) {
  const DeviceSpec spec = DeviceSpec::parse(R"(plugin:path=./a.so,options={"a":1,"b":[2,3],"path":"x=y"})");
  EXPECT_THAT(spec.options, ElementsAre(Pair("options", R"({"a":1,"b":[2,3],"path":"x=y"})"), Pair("path", "./a.so")));
}

TEST(DeviceSpec, ReadsAQuantityWithItsUnit) {
  const DeviceSpec spec = DeviceSpec::parse("sim:step=50us,lost_at=2s,lost_for=0.5,force=3kg,speed=2s");
  EXPECT_DOUBLE_EQ(spec.number("step", 0.0, 1.0, 0.0, "s"), 50e-6);
  EXPECT_EQ(spec.number("lost_at", 0.0, 10.0, 0.0, "s"), 2);
  EXPECT_EQ(spec.number("lost_for", 0.0, 10.0, 0.0, "s"), 0.5);
  EXPECT_THROW((void)spec.number("force", 0.0, 10.0, 0.0, "N"), Error) << "a mass is no force";
  EXPECT_THROW((void)spec.number("speed", 0.0, 10.0, 0.0), Error) << "a factor has no unit";
  EXPECT_THROW((void)spec.number("lost_at", 0.0, 1.0, 0.0, "s"), Error) << "2 s are more than 1 s";
}

TEST(DeviceSpec, NamesThePartItCannotRead) {
  EXPECT_THAT(refusal(""), HasSubstr("no name"));
  EXPECT_THAT(refusal(":preset=a"), HasSubstr("no name"));
  EXPECT_THAT(refusal("sim,hand=firm"), HasSubstr("','"));
  EXPECT_THAT(refusal("sim:"), HasSubstr("the option '' has no '='"));
  EXPECT_THAT(refusal("sim:preset"), HasSubstr("the option 'preset' has no '='"));
  EXPECT_THAT(refusal("sim:preset,hand=firm"), HasSubstr("the option 'preset' has no '='"));
  EXPECT_THAT(refusal("sim:hand=firm,"), HasSubstr("the option '' has no '='"));
  EXPECT_THAT(refusal("sim:=firm"), HasSubstr("no key"));
  EXPECT_THAT(refusal("sim:hand="), HasSubstr("the option 'hand' has no value"));
  EXPECT_THAT(refusal("sim:hand=,seed=1"), HasSubstr("the option 'hand' has no value"));
  EXPECT_THAT(refusal("sim:hand=firm,hand=none"), HasSubstr("the option 'hand' is given twice"));
  EXPECT_THAT(refusal("plugin:options="), HasSubstr("the option 'options' has no value"));
  EXPECT_THAT(refusal("sim:hand"), HasSubstr("NAME[:key=value[,key=value...]]"));
}

TEST(Registry, KnowsItsBackendsByName) {
  std::vector<std::string> names;
  for (const DeviceBackend& backend : device_backends()) {
    names.push_back(backend.name);
    EXPECT_FALSE(backend.summary.empty());
    EXPECT_NE(backend.open, nullptr);
  }
  EXPECT_THAT(names, testing::IsSupersetOf({"sim", "replay", "plugin"}));
}

TEST(Registry, SuggestsTheNearestDevice) {
  EXPECT_THAT(open_error("sin"), HasSubstr("there is no device 'sin'; did you mean 'sim'?"));
  EXPECT_THAT(open_error("quantum"), HasSubstr("known: "));
}

TEST(Registry, SuggestsTheNearestOption) {
  EXPECT_THAT(open_error("sim:prest=falcon"), HasSubstr("'sim' has no option 'prest'; did you mean 'preset'?"));
  EXPECT_THAT(open_error("replay:fiel=a.h5"), HasSubstr("did you mean 'file'?"));
}

TEST(Registry, GivesADeviceTheNameItWasAskedFor) {
  EXPECT_EQ(open_device("sim:preset=ideal,seed=4")->info().name, "sim:preset=ideal,seed=4");
}

}  // namespace
}  // namespace haptrace::test
