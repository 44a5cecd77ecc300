#!/bin/sh
# Names that make and a shell read as they are: the Makefile takes no others into its rules.
#   names.sh files PATTERN…          the files of the patterns, but those with other letters
#   names.sh scenes CASES TARGET…    the scenes in a folder, but those with other letters or the name of a target
LC_ALL=C
kind=$1
shift
if [ "$kind" = files ]; then
    for pattern; do
        for file in $pattern; do
            case $file in
                *[!A-Za-z0-9_./+=-]*) ;;
                *) [ -e "$file" ] && echo "$file" ;;
            esac
        done
    done
    exit 0
fi
cases=$1
shift
for folder in "$cases"/*/; do
    scene=$(basename "$folder")
    [ -e "$folder/scene.toml" ] || continue
    reserved=
    for target; do [ "$scene" = "$target" ] && reserved=:; done
    case $reserved$scene in
        :* | -* | *[!A-Za-z0-9_-]*)
            printf '%s is left out: a scene is named by letters, digits, _ and -, and not as a target\n' "$cases/$scene" >&2 ;;
        *) echo "$scene" ;;
    esac
done
