# Sourced: installs PCL, CMake and a compiler where that is possible and they are missing (Debian).
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null && ! dpkg -s libpcl-dev cmake g++ >/dev/null 2>&1; then
    { apt-get update -qq && apt-get install -y -qq libpcl-dev cmake g++ >/dev/null; } ||
        echo "PCL could not be installed: left out"
fi
