# Installs the build into a folder of its own, then configures, builds and runs the consumer against it.
#   cmake -DBUILD=... -DSOURCE=... -DOUT=... -DGENERATOR=... -DCOMPILER=... -DFLAGS=...
#   -DREADELF=... -DHARDENED=ON|OFF -DCHECKED=ON|OFF -DPLUGINS=A,B -P run.cmake
function(step)
  execute_process(COMMAND ${ARGV} RESULT_VARIABLE failed OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(failed)
    message(FATAL_ERROR "${ARGV}\n${output}")
  endif()
endfunction()

# Fails unless what readelf says of the file matches.
function(expect file options pattern what)
  execute_process(COMMAND ${READELF} ${options} -W ${file} RESULT_VARIABLE failed OUTPUT_VARIABLE output)
  if(failed OR NOT output MATCHES "${pattern}")
    message(FATAL_ERROR "${file}: ${what}\n${output}")
  endif()
endfunction()

# Programs and plug-ins: what a mistake in memory must not reach is out of reach.
function(expect_hardened file)
  expect(${file} -l "GNU_RELRO" "its tables of addresses are not made read-only (-z relro)")
  expect(${file} -d "BIND_NOW|FLAGS_1.* NOW" "its symbols are bound late (-z now)")
  expect(${file} -l "GNU_STACK[^\n]* RW +0x" "its stack can be executed")
endfunction()

file(REMOVE_RECURSE ${OUT})
step(${CMAKE_COMMAND} --install ${BUILD} --prefix ${OUT}/prefix)
if(HARDENED)
  file(GLOB programs ${OUT}/prefix/bin/* ${OUT}/prefix/libexec/*/*)
  foreach(program ${programs})
    expect_hardened(${program})
    expect(${program} -h "Type: +DYN" "is not position independent")
  endforeach()
  set(command ${OUT}/prefix/bin/haptrace)  # the others are too small to need either
  expect(${command} --dyn-syms "__stack_chk_fail" "has no stack protector")
  if(CHECKED)
    expect(${command} --dyn-syms "__(mem|str|read|pread|recv|v?snprintf|fdelt|realpath|getcwd)[a-z]*_chk"
           "calls no checked functions (FORTIFY)")
  endif()
  string(REPLACE "," ";" PLUGINS ${PLUGINS})
  foreach(plugin ${PLUGINS})
    expect_hardened(${plugin})
  endforeach()
else()
  message("HAPTRACE_HARDEN is off: the programs are not checked")
endif()
step(${CMAKE_COMMAND} -E compare_files ${SOURCE}/../../devices/udev/70-haptrace.rules
     ${OUT}/prefix/lib/udev/rules.d/70-haptrace.rules)
foreach(file bash-completion/completions/haptrace zsh/site-functions/_haptrace fish/vendor_completions.d/haptrace.fish
        man/man1/haptrace.1 man/man1/haptrace-play.1 man/man1/haptrace-stability-map.1)
  if(NOT EXISTS ${OUT}/prefix/share/${file})
    message(FATAL_ERROR "share/${file} is not installed")
  endif()
endforeach()
# What a program outside the tree may rely on. A header that becomes public, or ceases to be, is a decision: change the
# list with it.
file(GLOB_RECURSE headers RELATIVE ${OUT}/prefix/include/haptrace ${OUT}/prefix/include/haptrace/*)
file(STRINGS ${SOURCE}/public_headers.txt agreed)
list(SORT headers)
list(SORT agreed)
if(NOT headers STREQUAL agreed)
  set(added ${headers})
  list(REMOVE_ITEM added ${agreed})
  list(REMOVE_ITEM agreed ${headers})
  message(FATAL_ERROR "installed but not in tests/install/public_headers.txt: ${added}\nin the list but not installed: ${agreed}")
endif()
# The installed command takes the guardian beside itself, also where that of the build folder could be run.
file(GLOB guardian ${OUT}/prefix/libexec/haptrace/haptrace-guardian)
file(RENAME ${guardian} ${guardian}.watches)
file(WRITE ${guardian} "#!/bin/sh\n: >'${OUT}/guardian-ran'\nexec '${guardian}.watches'\n")
file(CHMOD ${guardian} PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE)
step(${OUT}/prefix/bin/haptrace record ${OUT}/guarded.h5 --device haply2diy:emulated=true --duration 0.2 --no-realtime)
file(RENAME ${guardian}.watches ${guardian})
if(NOT EXISTS ${OUT}/guardian-ran)
  message(FATAL_ERROR "the installed command did not run ${guardian}")
endif()
step(${CMAKE_COMMAND} -S ${SOURCE}/consumer -B ${OUT}/build -DCMAKE_PREFIX_PATH=${OUT}/prefix
     -G ${GENERATOR} -DCMAKE_CXX_COMPILER=${COMPILER} -DCMAKE_CXX_FLAGS=${FLAGS})
step(${CMAKE_COMMAND} --build ${OUT}/build)
step(${OUT}/build/consumer ${OUT}/recorded.h5)
step(${OUT}/prefix/bin/haptrace check ${OUT}/recorded.h5)
