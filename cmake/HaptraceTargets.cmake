# One library target per folder, alias haptrace::<folder>; warnings and sanitizers for our own code only.

add_library(haptrace_build_flags INTERFACE)
target_compile_options(haptrace_build_flags INTERFACE
  $<$<COMPILE_LANGUAGE:CXX>:-Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wnon-virtual-dtor -Woverloaded-virtual
    -Wno-missing-field-initializers>
  # If sources are compiled as one, the names of one shadow another's, and all sources look like headers.
  $<$<AND:$<COMPILE_LANGUAGE:CXX>,$<BOOL:$<TARGET_PROPERTY:UNITY_BUILD>>>:-Wno-shadow
    $<$<CXX_COMPILER_ID:GNU>:-Wshadow=local -Wno-subobject-linkage>>
  $<$<COMPILE_LANGUAGE:C>:-Wall -Wextra -Wpedantic -Wshadow -Wconversion>
  $<$<BOOL:${HAPTRACE_WERROR}>:-Werror>)
# Hardens installed code and plug-ins, because they read files and packets that others wrote. Tests and benchmarks
# replace functions of the C library, which FORTIFY does too; sanitizers check more than FORTIFY does.
add_library(haptrace_hardening INTERFACE)
if(HAPTRACE_HARDEN)
  target_compile_options(haptrace_hardening INTERFACE -fstack-protector-strong)
  if(NOT HAPTRACE_SANITIZE AND NOT HAPTRACE_FUZZ AND NOT HAPTRACE_RTSAN)
    # Without optimisation it is a warning and no help. Some compilers define it themselves.
    target_compile_options(haptrace_hardening INTERFACE $<$<NOT:$<CONFIG:Debug>>:-U_FORTIFY_SOURCE -D_FORTIFY_SOURCE=2>)
  endif()
  # Everything is bound before main(): nothing is looked up within a tick, and the tables of addresses are read-only.
  target_link_options(haptrace_hardening INTERFACE -Wl,-z,relro -Wl,-z,now -Wl,-z,noexecstack)
endif()

if(HAPTRACE_SANITIZE)
  add_compile_options(-fsanitize=${HAPTRACE_SANITIZE} -fno-omit-frame-pointer)
  # g++ 12 sees uninitialised values and accesses out of bounds in the standard library's own code once it is
  # instrumented. The other presets are built without these exceptions.
  target_compile_options(haptrace_build_flags INTERFACE -Wno-maybe-uninitialized
    $<$<CXX_COMPILER_ID:GNU>:-Wno-error=array-bounds -Wno-error=stringop-overflow -Wno-error=stringop-overread
      -Wno-error=restrict -Wno-error=null-dereference>)
  add_link_options(-fsanitize=${HAPTRACE_SANITIZE})
  if(HAPTRACE_SANITIZE MATCHES "thread")
    # ThreadSanitizer knows no fences; Asio's are for contexts that several threads run.
    add_compile_definitions(BOOST_ASIO_DISABLE_FENCED_BLOCK)
  endif()
  if(HAPTRACE_SANITIZE MATCHES "undefined")
    # What AddressSanitizer finds as well would take as long to compile as everything else.
    add_compile_options(-fno-sanitize-recover=undefined -fno-sanitize=null,alignment,object-size,vptr)
  endif()
endif()
if(HAPTRACE_FUZZ)
  add_compile_options(-fsanitize=fuzzer-no-link,address,undefined -fno-sanitize-recover=undefined
    -fno-omit-frame-pointer)
  add_link_options(-fsanitize=address,undefined)
endif()
if(HAPTRACE_RTSAN)
  find_library(HAPTRACE_RTSAN_LIBRARY clang_rt.rtsan-x86_64
               NAMES libclang_rt.rtsan-x86_64.a PATHS /usr/lib/llvm-19/lib/clang/19/lib/linux REQUIRED)
  add_compile_definitions(HAPTRACE_RTSAN)
  # The runtime's interceptors have to be in every program, called or not; plug-ins use their program's.
  set(runtime -Wl,--whole-archive ${HAPTRACE_RTSAN_LIBRARY} -Wl,--no-whole-archive -rdynamic)
  add_link_options("$<$<STREQUAL:$<TARGET_PROPERTY:TYPE>,EXECUTABLE>:${runtime}>")
  link_libraries(dl pthread m)
endif()

# Forty programs are linked for the tests: mold takes a third of the time that the usual linker does.
find_program(HAPTRACE_MOLD mold)
if(HAPTRACE_BUILD_TESTS AND HAPTRACE_MOLD AND NOT HAPTRACE_SANITIZE AND NOT HAPTRACE_RTSAN AND NOT HAPTRACE_FUZZ
   AND CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_GREATER_EQUAL 12.1)
  add_link_options(-fuse-ld=mold)
endif()

# Headers that nearly every source includes, or that take long to compile, are precompiled once for all libraries. A
# source still includes every header that it uses: clang-tidy reads each by itself.
set(HAPTRACE_PRECOMPILED <Eigen/Geometry> <algorithm> <array> <cmath> <filesystem> <functional> <map> <memory>
  <optional> <span> <string> <string_view> <vector> <nlohmann/json.hpp>)
file(CONFIGURE OUTPUT ${CMAKE_BINARY_DIR}/precompiled.cpp CONTENT "")
add_library(haptrace_precompiled OBJECT EXCLUDE_FROM_ALL ${CMAKE_BINARY_DIR}/precompiled.cpp)
target_compile_features(haptrace_precompiled PUBLIC cxx_std_20)
target_link_libraries(haptrace_precompiled PRIVATE Eigen3::Eigen fmt::fmt nlohmann_json::nlohmann_json
  haptrace_build_flags haptrace_hardening)
target_precompile_headers(haptrace_precompiled PRIVATE ${HAPTRACE_PRECOMPILED} <fmt/format.h>)

# haptrace_library(<folder> SOURCES <file>... [ALONE <file>...] [PUBLIC <target>...] [PRIVATE <target>...])
# With HAPTRACE_UNITY, eight sources are compiled as one; ALONE names those of `SOURCES` that give a private name to
# something else than another source does, or that need a shared library which a small program does without.
function(haptrace_library folder)
  cmake_parse_arguments(ARG "" "" "SOURCES;ALONE;PUBLIC;PRIVATE" ${ARGN})
  add_library(haptrace_${folder} STATIC ${ARG_SOURCES})
  add_library(haptrace::${folder} ALIAS haptrace_${folder})
  set_target_properties(haptrace_${folder} PROPERTIES EXPORT_NAME ${folder} UNITY_BUILD ${HAPTRACE_UNITY}
    UNITY_BUILD_BATCH_SIZE 8)
  set_source_files_properties(${ARG_ALONE} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
  # In the tree and installed, a header is included by the same words: "control/path/path.h".
  target_include_directories(haptrace_${folder} PUBLIC
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}> $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}/haptrace>)
  target_compile_features(haptrace_${folder} PUBLIC cxx_std_20)
  target_link_libraries(haptrace_${folder}
    PUBLIC ${ARG_PUBLIC} PRIVATE ${ARG_PRIVATE} $<BUILD_INTERFACE:haptrace_build_flags> $<BUILD_INTERFACE:haptrace_hardening>)
  target_precompile_headers(haptrace_${folder} REUSE_FROM haptrace_precompiled)
  set_property(GLOBAL APPEND PROPERTY HAPTRACE_LIBRARIES haptrace_${folder})
endfunction()

# Ends what hangs, whatever the machine: no test is judged by the time that it takes [s].
set(HAPTRACE_TEST_HANGS 1800)
if(HAPTRACE_SANITIZE OR HAPTRACE_RTSAN)
  set(HAPTRACE_TEST_HANGS 14400)  # one process runs all tests of a program, for an hour where nothing else runs
endif()

# haptrace_test(<name> SOURCES <file>... LIBS <target>... [LAWS <sentence>] [REAL_TIME] [AS_SHIPPED]): one GoogleTest
# program. Every test is a test of ctest; its suites of laws, named All/..., are one together, called by the sentence;
# tests named DISABLED_ are run by hand.
# Laws in real time wait for each other. AS_SHIPPED: what headers hold is optimised as in a program that is shipped.
function(haptrace_test name)
  cmake_parse_arguments(ARG "REAL_TIME;AS_SHIPPED" "LAWS" "SOURCES;LIBS" ${ARGN})
  add_executable(test_${name} ${ARG_SOURCES})
  target_link_libraries(test_${name} PRIVATE ${ARG_LIBS} haptrace_test_main haptrace_build_flags)
  target_include_directories(test_${name} PRIVATE ${PROJECT_SOURCE_DIR})
  # Sixteen sources at a time take two thirds less to compile: most of it is gtest's and gmock's headers. Names in the
  # unnamed namespaces of a folder of tests therefore differ.
  set_target_properties(test_${name} PROPERTIES UNITY_BUILD ${HAPTRACE_UNITY} UNITY_BUILD_BATCH_SIZE 16)
  # Replaces new and delete, which a compiler that sees them takes for a mistake.
  set_source_files_properties(${PROJECT_SOURCE_DIR}/tests/support/allocations.cpp
    PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
  get_property(first GLOBAL PROPERTY HAPTRACE_FIRST_TEST)
  if(NOT ARG_AS_SHIPPED)
    # Half of what the tests cost is compiling them, a quarter of that optimising what runs once.
    target_compile_options(test_${name} PRIVATE $<$<CONFIG:Release>:-O1>)
  endif()
  # An eighth, writing down for a debugger what the other presets have, too.
  target_compile_options(test_${name} PRIVATE $<$<CONFIG:Release>:-g0>)
  if(ARG_AS_SHIPPED)
    # Its precompiled headers would have to be optimised in the same way.
  elseif(first)  # of base, where no macro is defined that others lack
    target_precompile_headers(test_${name} REUSE_FROM ${first})
  else()
    target_precompile_headers(test_${name} PRIVATE ${HAPTRACE_PRECOMPILED} <gmock/gmock.h> <gtest/gtest.h>)
    set_property(GLOBAL PROPERTY HAPTRACE_FIRST_TEST test_${name})
  endif()
  # Suites of laws (All/...) hold hundreds of short tests: one process runs them together, each of the others its own.
  # With a sanitizer a process takes seconds to start, so one runs all; GTEST_FILTER chooses among them.
  if(HAPTRACE_SANITIZE OR HAPTRACE_RTSAN)
    add_test(NAME Tests.${name} COMMAND test_${name} --gtest_brief=1)
    set_tests_properties(Tests.${name} PROPERTIES TIMEOUT ${HAPTRACE_TEST_HANGS} COST 70)
    if(ARG_REAL_TIME)
      set_tests_properties(Tests.${name} PROPERTIES RESOURCE_LOCK real_time)
    endif()
  else()
    gtest_discover_tests(test_${name} DISCOVERY_MODE PRE_TEST DISCOVERY_TIMEOUT 60 NO_PRETTY_VALUES
      TEST_FILTER "-All/*:*DISABLED_*" PROPERTIES TIMEOUT ${HAPTRACE_TEST_HANGS})
  endif()
  if(ARG_LAWS)
    add_test(NAME Laws.${ARG_LAWS} COMMAND test_${name} --gtest_brief=1 --gtest_filter=All/*)
    set_tests_properties(Laws.${ARG_LAWS} PROPERTIES TIMEOUT ${HAPTRACE_TEST_HANGS})
    if(ARG_REAL_TIME)
      set_tests_properties(Laws.${ARG_LAWS} PROPERTIES RESOURCE_LOCK real_time COST 60)
    endif()
  endif()
endfunction()

# Sets `result` to the headers that `header` reaches through its includes, itself among them: the public ones.
function(haptrace_public_headers result header)
  set(found)
  set(left ${header})
  while(left)
    list(POP_FRONT left next)
    list(APPEND found ${next})
    file(STRINGS ${PROJECT_SOURCE_DIR}/${next} includes REGEX "^#include \"")
    foreach(line ${includes})
      string(REGEX REPLACE "^#include \"([^\"]+)\".*" "\\1" include "${line}")
      if(NOT include IN_LIST found AND NOT include IN_LIST left)
        list(APPEND left ${include})
      endif()
    endforeach()
    # A header that comes to include another is public with it at the next build.
    set_property(DIRECTORY ${PROJECT_SOURCE_DIR} APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/${next})
  endwhile()
  set(${result} ${found} PARENT_SCOPE)
endfunction()

function(haptrace_install)
  include(CMakePackageConfigHelpers)
  get_property(libraries GLOBAL PROPERTY HAPTRACE_LIBRARIES)
  install(TARGETS ${libraries} EXPORT haptraceTargets ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
  install(EXPORT haptraceTargets NAMESPACE haptrace:: DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/haptrace)
  haptrace_public_headers(headers haptrace.h)
  foreach(header ${headers})
    get_filename_component(folder ${header} DIRECTORY)
    install(FILES ${header} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/haptrace/${folder})
  endforeach()
  set(HAPTRACE_BUILT_WITH_OCCT OFF)
  if(TARGET haptrace_occt)
    set(HAPTRACE_BUILT_WITH_OCCT ON)
  endif()
  configure_package_config_file(cmake/haptraceConfig.cmake.in haptraceConfig.cmake
    INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/haptrace)
  write_basic_package_version_file(haptraceConfigVersion.cmake COMPATIBILITY SameMinorVersion)
  install(FILES ${CMAKE_CURRENT_BINARY_DIR}/haptraceConfig.cmake ${CMAKE_CURRENT_BINARY_DIR}/haptraceConfigVersion.cmake
          ${PROJECT_SOURCE_DIR}/cmake/HaptraceDependencies.cmake
          DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/haptrace)
  install(TARGETS haptrace RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
  # Completions and manual pages: the command prints them from its own options.
  set(generated ${PROJECT_BINARY_DIR}/completion)
  add_custom_command(OUTPUT ${generated}/made
    COMMAND haptrace completion bash -o ${generated}/bash
    COMMAND haptrace completion zsh -o ${generated}/zsh
    COMMAND haptrace completion fish -o ${generated}/fish
    COMMAND haptrace completion man -o ${generated}/man
    COMMAND ${CMAKE_COMMAND} -E touch ${generated}/made
    DEPENDS haptrace VERBATIM)
  add_custom_target(haptrace_completion ALL DEPENDS ${generated}/made)
  install(DIRECTORY ${generated}/bash/ DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions)
  install(DIRECTORY ${generated}/zsh/ DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/site-functions)
  install(DIRECTORY ${generated}/fish/ DESTINATION ${CMAKE_INSTALL_DATADIR}/fish/vendor_completions.d)
  install(DIRECTORY ${generated}/man/ DESTINATION ${CMAKE_INSTALL_MANDIR}/man1)
  install(FILES LICENSE README.md DESTINATION ${CMAKE_INSTALL_DOCDIR})
  install(FILES devices/udev/70-haptrace.rules DESTINATION lib/udev/rules.d)
  install(FILES formats/documents/programme.schema.json formats/documents/device_frame.schema.json scene/scene.schema.json DESTINATION ${CMAKE_INSTALL_DATADIR}/haptrace)
endfunction()
