#include "devices/vendor/find_plugged.h"
#include "devices/vendor/force_dimension.h"
#include "devices/vendor/open_haptics.h"
#include "tests/devices/device_laws.h"
#include "tests/devices/vendor/support.h"

#include <gmock/gmock.h>

namespace haptrace::test {

std::vector<Listed> listed_devices() {
  const auto drd = [](int type) {
    return [type] {
      renew(fake_drd()).type = type;
      return open_device("forcedimension:library=" FAKE_DRD);
    };
  };
  const auto hd = [](int dof) {
    return [dof] {
      renew(fake_hd()).output_dof = dof;
      return open_device("openhaptics:library=" FAKE_HD);
    };
  };
  return {{"omega3", drd(33), true, true, false},
          {"sigma7", drd(104), true, true, false},
          {"touch", hd(3), true, true, false}};
}

namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using Unload = SharedLibrary::Unload;

TEST(SharedLibrary, HandsOutFunctionsOfTheTypeTheyAreAssignedTo) {
  const SharedLibrary library("the fake", FAKE_DRD, Unload::with_this);
  int (*count)() = library.function("dhdGetDeviceCount");
  renew(fake_drd()).devices = 5;
  EXPECT_EQ(count(), 5);
  int (*missing)() = library.function_if_any("dhdFlyToTheMoon");
  EXPECT_EQ(missing, nullptr);
  const auto ask = [&] {
    int (*f)() = library.function("dhdFlyToTheMoon", "get a newer one");
    (void)f;
  };
  EXPECT_THAT(error_of(ask, Error::Kind::device),
              AllOf(HasSubstr("the fake"), HasSubstr(FAKE_DRD), HasSubstr("'dhdFlyToTheMoon'; get a newer one")));
}

TEST(SharedLibrary, NamesEveryPlaceThatWasTriedWithTheReason) {
  const TempFolder folder;
  const std::string text = folder.write("libtext.so", "not a library");
  const WantedLibrary wanted{"the vendor's library", {"/no/such/libx.so", text, "libnosuchthing.so"}, "install it"};
  EXPECT_THAT(error_of([&] { const SharedLibrary library(wanted, Unload::never); }, Error::Kind::device),
              AllOf(HasSubstr("the vendor's library is missing"), HasSubstr("/no/such/libx.so (there is no such file)"),
                    HasSubstr(text + " (file too short)"), HasSubstr("libnosuchthing.so (not in the system's folders)"),
                    HasSubstr("install it")));
}

TEST(SharedLibrary, TakesTheFirstPlaceThatHasIt) {
  const SharedLibrary library({"it", {"/no/such/libx.so", FAKE_HD, FAKE_DRD}, ""}, Unload::never);
  EXPECT_EQ(library.file(), FAKE_HD);
}

TEST(SharedLibrary, FindsTheNewestVersionInAFolderFirst) {
  const TempFolder folder;
  for (const char* name : {"libHD.so.3.9.0", "libHD.so.3.10.0", "libHD.so", "libHDU.so"}) (void)folder.write(name, "");
  EXPECT_THAT(
      library_files({folder.path(), "/nowhere"}, "libHD.so"),
      ElementsAre(folder / "libHD.so.3.10.0", folder / "libHD.so.3.9.0", folder / "libHD.so", "/nowhere/libHD.so"));
}

TEST(FindPlugged, DistinguishesAMissingLibraryFromAMissingDevice) {
  const TempFolder root, empty;
  plug_usb(root, "1451", "0402");
  WantedLibrary library = force_dimension_library();
  library.places = {FAKE_DRD};
  EXPECT_THAT(find_plugged("Force Dimension", "forcedimension", library, empty.path()), IsEmpty());

  auto found = find_plugged("Force Dimension", "forcedimension", library, root.path());
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].spec, "forcedimension");
  EXPECT_EQ(found[0].where, "usb 1-1");
  EXPECT_EQ(found[0].obstacle, "");

  library.places = {"/no/such/libdrd.so"};
  found = find_plugged("Force Dimension", "forcedimension", library, root.path());
  ASSERT_EQ(found.size(), 1U);
  EXPECT_THAT(found[0].obstacle, HasSubstr("/no/such/libdrd.so (there is no such file)"));
  EXPECT_THAT(found[0].remedy, HasSubstr("forcedimension:library="));
}

TEST(FindPlugged, KnowsBothIdsOfATouch) {
  for (const auto& [vendor, product] : {std::pair("2988", "0302"), std::pair("0301", "2988")}) {
    const TempFolder root;
    plug_usb(root, vendor, product);
    const auto found = find_plugged("3D Systems Touch", "openhaptics", {"libHD", {FAKE_HD}, ""}, root.path());
    ASSERT_EQ(found.size(), 1U);
    EXPECT_EQ(found[0].obstacle, "");
  }
}

TEST(FindPlugged, ReportsADeviceThatCannotBeOpened) {
  const TempFolder root;
  plug_usb(root, "1451", "0402");
  std::filesystem::remove(root / "dev/bus/usb/001/004");
  const auto found = find_plugged("Force Dimension", "forcedimension", {"libdrd", {FAKE_DRD}, ""}, root.path());
  ASSERT_EQ(found.size(), 1U);
  EXPECT_THAT(found[0].obstacle, HasSubstr("/dev/bus/usb/001/004: No such file"));
  EXPECT_THAT(found[0].remedy, HasSubstr("udevadm"));
}

}  // namespace
}  // namespace haptrace::test
