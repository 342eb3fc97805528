// Finds `extras.wrinkle` in a .glb or .gltf file, as engines' importers leave extras out.

using System;
using System.Collections.Generic;
using System.Linq;
using System.Text;

namespace Wrinkles
{
    using Json = Dictionary<string, object>;

    public static class GltfExtras
    {
        /// <summary>The JSON of a file, and where its own buffer begins: -1 if it has none.</summary>
        internal static Json Document(byte[] file, out int data)
        {
            // Of a .glb: 12 bytes of header, then each chunk's length and kind before it: that of JSON and that of bytes.
            var binary = file.Length > 20 && Encoding.ASCII.GetString(file, 0, 4) == "glTF";
            var size = binary ? BitConverter.ToInt32(file, 12) : 0;
            data = binary && file.Length > 28 + size ? 28 + size : -1;
            var text = binary ? Encoding.UTF8.GetString(file, 20, size) : Encoding.UTF8.GetString(file);
            return JsonText.Parse(text) is Json gltf ? gltf : throw new FormatException("not glTF");
        }

        /// <summary>By node's name its `extras.wrinkle`; FormatException if the file is not glTF.</summary>
        public static Dictionary<string, Json> Wrinkles(byte[] file)
        {
            var gltf = Document(file, out _);
            var nodes = gltf.TryGetValue("nodes", out var all) ? ((List<object>)all).Cast<Json>() : new Json[0];
            var found = new Dictionary<string, Json>();
            foreach (var node in nodes)
                if (node.TryGetValue("extras", out var extras) && extras is Json keys && keys.TryGetValue("wrinkle", out var entry)
                    && entry is Json wrinkle && node.TryGetValue("name", out var name))
                    found[(string)name] = wrinkle;
            return found;
        }
    }
}
