#!/bin/sh
# The commands `piv` and `softfinger`, and the packages in Python, from any folder: writes both into the environment $1, which is .venv of a clone.
# They belong to the clone that the environment is in, or is linked from, also after it was moved.
echo 'import os, sys; sys.path.append(os.path.dirname(sys.prefix))' \
    >"$("$1/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/softfinger.pth"
for command in piv:piv softfinger:softfinger; do
    cat >"$1/bin/${command%:*}" <<END
#!/bin/sh
self=\$0
[ ! -L "\$self" ] || self=\$(readlink -f "\$self")
exec "\$(dirname "\$self")/python" -P -m ${command#*:} "\$@"
END
    chmod +x "$1/bin/${command%:*}"
done
