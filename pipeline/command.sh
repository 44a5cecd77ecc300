#!/bin/sh
# The command `piv`, and the packages in Python, from any folder: writes both into the environment $1, which is .venv of a clone.
# They belong to the clone that the environment is in, or is linked from, also after it was moved.
echo 'import os, sys; sys.path.append(os.path.dirname(sys.prefix))' \
    >"$("$1/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/softfinger.pth"
cat >"$1/bin/piv" <<'END'
#!/bin/sh
self=$0
[ ! -L "$self" ] || self=$(readlink -f "$self")
exec "$(dirname "$self")/python" -P -m piv "$@"
END
chmod +x "$1/bin/piv"
